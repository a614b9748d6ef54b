"""Functions of an equation of motion, with bands: what a record determines, and what not.

`series` has the equation, `prior` says how smooth its functions are, `windows` compares it with the
records, `evidence` weighs what the data support and draws functions that may be true, and
`identify` puts them together.
"""
