"""Functions of an equation of motion, with bands: what a record determines, and what not.

`series` has the equation, `windows` compares it with the records, `evidence` says how smooth its
functions are, weighs what the data support and draws functions that may be true, and `identify`
puts them together.
"""
