"""The study of the method's paper on the default beam, from simulation to report.

`system` simulates the structure, `models` identifies it, `experiment` measures it with noise,
`harmonics` chooses harmonics; `tables` and `figures` show the results, `chapters` tell the story,
`pages` writes it; `command` is `romsindy study`, found by its entry point. M. W. Ahmadi,
T. L. Hill, J. Z. Jiang, S. A. Neild, Nonlinear Dynamics (2023), doi 10.1007/s11071-023-08813-z;
section numbers in this package are the paper's.
"""
