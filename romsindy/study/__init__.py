"""The study of the method's paper on the default beam, from simulation to report.

`system` simulates the structure, `models` identifies it, `experiment` measures it with noise,
`harmonics` chooses harmonics; `tables` and `figures` show the results, `chapters` tell the story,
`pages` writes it. M. W. Ahmadi, T. L. Hill, J. Z. Jiang, S. A. Neild, Nonlinear Dynamics (2023),
doi 10.1007/s11071-023-08813-z; section numbers in this package are the paper's.
"""

from romsindy.study.experiment import Trial, measured_decay, trials
from romsindy.study.harmonics import choose_harmonics
from romsindy.study.models import FAMILIES, ORDERS, PAPER, identify, identify_all
from romsindy.study.system import System, simulate_system
