"""What a simulation lacks, from vibrations that measured inputs drive."""
