"""Terms as PySINDy feature libraries, of one coordinate or several: thin adaptors.

The columns are [q, q_dot, q_ddot] by default; ``channels`` says where they are. In plain PySINDy
the equation is implicit, and x = q, u = [q_dot, q_ddot], x_dot = -q_ddot carries it; see
`ROMLibrary` for an example. `pysindy.SINDy.simulate` integrates explicit equations alone: make a
`ReducedModel` of the coefficients instead.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from pysindy import AxesArray, ConcatLibrary
from pysindy.feature_library.base import BaseFeatureLibrary, x_sequence_or_item
from pysindy.utils import comprehend_axes
from sklearn.utils.validation import check_is_fitted

from romsindy.physics.coupling import Along, CoupledTerm, MixedStiffness, Powers, SlavedInertia
from romsindy.physics.damping import damping_law
from romsindy.physics.inertia import AddedMass, Inertia, LinearConvection, QuadraticInertia
from romsindy.physics.integration import EscapeError
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Term
from romsindy.record.decay import Decay
from romsindy.typing import Array


def is_coupled(terms: Sequence[Term]) -> bool:
    """Whether there are terms of several coordinates among them."""
    return any(isinstance(term, CoupledTerm) for term in terms)


def _products(modes: int, degree: int) -> list[Powers]:
    """Powers of all products of the coordinates of a degree, those of q1 first."""
    chosen = combinations_with_replacement(range(modes), degree)
    return [tuple(factors.count(i) for i in range(modes)) for factors in chosen]


def _slaved(modes: int, order: int) -> list[SlavedInertia]:
    """Products of shapes of slaved modes: of degrees a and b, alike or next, a + b = order + 1."""
    if isinstance(order, bool) or order != int(order) or order < 3:
        raise ValueError(
            f"inertia names the order {order!r}: with several modes orders are whole numbers of at"
            " least 3, the products of quadratic shapes"
        )
    low = (int(order) + 1) // 2
    first, second = _products(modes, low), _products(modes, int(order) + 1 - low)
    if first == second:
        return [SlavedInertia(a, b) for a, b in combinations_with_replacement(first, 2)]
    return [SlavedInertia(a, b) for a in first for b in second]


_FAR = 1000.0  # times the motion of the fit


def _signals(x: Any, channels: Sequence[int]) -> Array:
    """q, q_dot and q_ddot of (n, n_columns), (3, n)."""
    return np.moveaxis(np.asarray(x)[..., list(channels)], -1, 0)


def _size(signals: Array) -> Array:
    """Largest absolute values, (3,); samples that are no numbers, which PySINDy drops, aside."""
    return np.fmax.reduce(np.abs(signals), axis=1)


class TermLibrary(BaseFeatureLibrary):
    """A feature library whose columns are the strong forms of `terms`.

    A subclass is a dataclass of its parameters, the `channels` among them, and states `terms`.
    """

    channels: Sequence[int]

    @property
    @abstractmethod
    def terms(self) -> tuple[Term, ...]:
        """The terms, in the order of the columns."""

    @x_sequence_or_item
    def fit(self, x: Any, y: Any = None) -> TermLibrary:
        """Check the number of columns.

        Raises
        ------
        ValueError
            If a channel lies beyond the columns of x, or a term is listed twice.
        TypeError
            If the terms are those of several coordinates.
        """
        if is_coupled(self.terms):
            raise TypeError(
                "the library has terms of several coordinates, whose equations share coefficients;"
                " pysindy.SINDy fits every equation by itself: use HarmonicSINDy(library)"
            )
        n_columns = x[0].shape[-1]
        if len(self.channels) != 3 or max(self.channels) >= n_columns or min(self.channels) < 0:
            raise ValueError(
                f"channels = {tuple(self.channels)} must name the columns of q, q_dot and q_ddot,"
                f" but x has {n_columns} column{'s' * (n_columns != 1)}"
            )
        keys = [term.key for term in self.terms]
        if len(set(keys)) != len(keys):
            raise ValueError(f"terms are listed twice in {keys}")
        self.n_features_in_ = n_columns
        reach = np.fmax.reduce([_size(_signals(xi, self.channels)) for xi in x])
        self._reach = np.where(reach > 0, reach, np.inf)
        self.n_output_features_ = len(keys)
        return self

    @x_sequence_or_item
    def transform(self, x: Any) -> list[AxesArray]:
        """Evaluate every term on every sample: (n, n_columns) -> (n, n_terms).

        Raises
        ------
        ValueError
            If x has another number of columns than in `fit`.
        EscapeError
            If the motion is a thousand times as large as in `fit`: only a simulation that escapes
            goes there.
        """
        check_is_fitted(self)
        features = []
        for xi in x:
            if xi.shape[-1] != self.n_features_in_:
                raise ValueError(
                    f"X has {xi.shape[-1]} features, but {type(self).__name__} is expecting"
                    f" {self.n_features_in_} features as input: give the columns of fit, of which"
                    f" channels = {tuple(self.channels)} are q, q_dot and q_ddot"
                )
            signals = _signals(xi, self.channels)
            self._refuse_escape(signals)
            columns = np.stack([term.strong(*signals) for term in self.terms], axis=-1)
            features.append(AxesArray(columns, comprehend_axes(columns)))
        return features

    def _refuse_escape(self, signals: Array) -> None:
        # PySINDy integrates what is implicit as if it were explicit, and would go on for hours.
        size = _size(signals)
        if np.any(size > _FAR * self._reach):
            raise EscapeError(
                f"q, q_dot, q_ddot reach {size}, {_FAR:.0f} times as much as in fit, {self._reach}:"
                " give x in the units of fit; pysindy.SINDy.simulate cannot integrate an implicit"
                " equation: use"
                " ReducedModel(library.terms, model.coefficients()[0]).simulate"
            )

    def get_feature_names(self, input_features: Sequence[str] | None = None) -> list[str]:
        """Text of every term, in the names of the columns."""
        names = ["q", "q_dot", "q_ddot"]
        if input_features is not None:
            names = [input_features[c] for c in self.channels]
        return [term.expression(*names) for term in self.terms]

    def get_feature_names_out(self, input_features: Sequence[str] | None = None) -> np.ndarray:
        """`get_feature_names` as scikit-learn calls it."""
        return np.array(self.get_feature_names(input_features), dtype=object)


@dataclass(eq=False, repr=False)
class ICROMLibrary(TermLibrary):
    """Inertial compensation of the given orders (`Inertia`).

    Examples
    --------
    >>> ICROMLibrary(orders=(3,)).get_feature_names()
    ['(q^2 q_ddot + q q_dot^2)']
    """

    orders: Sequence[int] = (3, 4, 5)
    channels: Sequence[int] = (0, 1, 2)

    @property
    def terms(self) -> tuple[Term, ...]:
        return tuple(Inertia(order) for order in self.orders)


@dataclass(eq=False, repr=False)
class StiffnessLibrary(TermLibrary):
    """Powers of q: omega^2 for degree 1, gamma_m beyond (`Stiffness`).

    Examples
    --------
    >>> [term.key for term in StiffnessLibrary(degrees=(1, 3)).terms]
    ['omega^2', 'gamma_3']
    """

    degrees: Sequence[int] = (1, 2, 3, 4, 5)
    channels: Sequence[int] = (0, 1, 2)

    @property
    def terms(self) -> tuple[Term, ...]:
        return tuple(Stiffness(degree) for degree in self.degrees)


@dataclass(eq=False, repr=False)
class DampingLibrary(TermLibrary):
    """Damping terms: "linear", "quadratic", "coulomb", "cubic", "q^2 q_dot".

    Examples
    --------
    >>> DampingLibrary(["linear", "quadratic"]).get_feature_names()
    ['q_dot', '|q_dot| q_dot']
    """

    kinds: Sequence[str] = ("linear",)
    channels: Sequence[int] = (0, 1, 2)

    @property
    def terms(self) -> tuple[Term, ...]:
        kinds = [self.kinds] if isinstance(self.kinds, str) else self.kinds
        return tuple(damping_law(kind) for kind in kinds)


@dataclass(eq=False, repr=False)
class BeamTheoryLibrary(TermLibrary):
    """The cantilever model from the literature: q^2 q_ddot and q q_dot^2 with coefficients apart.

    Eq. (8) of the method's paper; add a `StiffnessLibrary` and a `DampingLibrary` to it.

    Examples
    --------
    >>> from romsindy import HarmonicSINDy, example_decay
    >>> library = BeamTheoryLibrary() + StiffnessLibrary((1, 3)) + DampingLibrary()
    >>> list(HarmonicSINDy(library).fit(example_decay(periods=30)).model_.coefficients)
    ['beta_1', 'beta_2', 'omega^2', 'gamma_3', 'c_linear']
    """

    channels: Sequence[int] = (0, 1, 2)

    @property
    def terms(self) -> tuple[Term, ...]:
        return (QuadraticInertia(), LinearConvection())


@dataclass(eq=False, repr=False)
class ROMLibrary(TermLibrary):
    """Inertia, stiffness and damping terms in one flat library, so that grids can search them.

    Parameters
    ----------
    inertia : sequence of int
        Orders of the inertial compensation, ``()`` for a stiffness polynomial alone.
    stiffness : sequence of int
        Powers of q.
    damping : sequence of str
        Kinds of damping.
    channels : (int, int, int)
        Columns of q, q_dot and q_ddot.
    modes : int
        How many coordinates q1, q2, ... there are, the lowest mode first. With more than one,
        stiffness and damping are those of each coordinate; a stiffness of degree m > 1 adds all
        products of coordinates of degree m + 1 in the potential (`MixedStiffness`), and inertia of
        order 3, 4, 5 all products of two shapes of slaved modes (`SlavedInertia`) that are
        quadratic, quadratic and cubic, cubic. A regression does not demand that these products
        belong to shapes, which makes M - 1 positive semidefinite. A term has one coefficient in all
        equations where it stands, so the library is for `HarmonicSINDy`; plain PySINDy, which fits
        every equation by itself, is refused.
    masses : bool
        With several modes: whether those from the second on have a mass beside that of the first
        (``mu [q2]``). Coordinates are scaled by the sensors, and then their masses differ.

    Raises
    ------
    ValueError
        By `terms`, if modes is no whole number of at least 1, or masses come without modes.

    Examples
    --------
    >>> [term.key for term in ROMLibrary((), (1, 2), modes=2).terms]  # doctest: +ELLIPSIS
    ['omega^2 [q1]', 'omega^2 [q2]', 'gamma_2 [q1]', 'gamma_2 [q2]', 'V q1^2 q2', ...]

    In plain PySINDy. The columns are those of x and u side by side; here a temperature comes first,
    and ``channels`` says where the motion is.

    >>> import numpy as np
    >>> import pysindy as ps
    >>> from romsindy import ReducedModel, ROMLibrary, ScaledOptimizer, example_decay, implicit_data
    >>> decay = example_decay()
    >>> library = ROMLibrary(inertia=(3, 4, 5), stiffness=(1, 2, 3), channels=(1, 2, 3))
    >>> data = implicit_data(decay)
    >>> temperature = 20 + 0.1 * decay.t
    >>> data["x"] = np.column_stack([temperature, data["x"]])
    >>> data["x_dot"] = np.column_stack([np.full_like(decay.t, 0.1), data["x_dot"]])
    >>> model = ps.SINDy(feature_library=library, optimizer=ScaledOptimizer())
    >>> model = model.fit(t=decay.t, feature_names=["T", "q", "q_dot", "q_ddot"], **data)
    >>> equation = ReducedModel(library.terms, model.coefficients()[1], unit=decay.unit)
    >>> print(equation.equation())  # doctest: +ELLIPSIS
    q_ddot + 0.3 (q^2 q_ddot + q q_dot^2) + ...
    >>> motion = equation.simulate(1.8, 0.0, decay.t)
    """

    inertia: Sequence[int] = (3, 4, 5)
    stiffness: Sequence[int] = (1, 2, 3, 4, 5)
    damping: Sequence[str] = ("linear",)
    channels: Sequence[int] = (0, 1, 2)
    modes: int = 1
    masses: bool = False

    @property
    def terms(self) -> tuple[Term, ...]:
        whole = isinstance(self.modes, (int, np.integer)) and not isinstance(self.modes, bool)
        if not whole or self.modes < 1:
            raise ValueError(f"modes = {self.modes!r} must be a whole number of at least 1")
        if self.modes > 1:
            return self._of_modes()
        if self.masses:
            raise ValueError("masses = True needs modes of at least 2: q1 has the mass 1")
        return (
            ICROMLibrary(self.inertia).terms
            + StiffnessLibrary(self.stiffness).terms
            + DampingLibrary(self.damping).terms
        )

    def _of_modes(self) -> tuple[CoupledTerm, ...]:
        """The terms of several coordinates."""
        modes, numbers = self.modes, range(1, self.modes + 1)
        found: list[CoupledTerm] = []
        for order in self.inertia:
            found += _slaved(modes, order)
        for degree in self.stiffness:
            found += [Along.coordinate(Stiffness(degree), i) for i in numbers]
        for degree in self.stiffness:
            if degree > 1:  # coordinates are modes: small motions are not coupled
                products = _products(modes, degree + 1)
                found += [MixedStiffness(p) for p in products if max(p) <= degree]
        for kind in [self.damping] if isinstance(self.damping, str) else self.damping:
            found += [Along.coordinate(damping_law(kind), i) for i in numbers]
        if self.masses:
            found += [Along.coordinate(AddedMass(), i) for i in numbers[1:]]
        return tuple(found)


def library_terms(library: BaseFeatureLibrary) -> tuple[Term, ...]:
    """The terms of a library of this package, or of a sum of them.

    Raises a TypeError if the library has columns that are no terms of an equation of motion.
    """
    if isinstance(library, ConcatLibrary):
        return tuple(term for part in library.libraries for term in library_terms(part))
    if not isinstance(library, TermLibrary):
        raise TypeError(
            f"{type(library).__name__} is not a library of terms: use ROMLibrary, ICROMLibrary,"
            " StiffnessLibrary, DampingLibrary, BeamTheoryLibrary or sums of them;"
            " for other libraries take pysindy.SINDy with HarmonicLibrary"
        )
    return library.terms


def implicit_data(decay: Decay) -> dict[str, np.ndarray]:
    """Arguments of `pysindy.SINDy.fit` for a decay with derivatives.

    x (n, 1) = q, u (n, 2) = [q_dot, q_ddot], x_dot (n, 1) = -q_ddot.

    Raises
    ------
    ValueError
        If the decay lacks velocity or acceleration.

    Examples
    --------
    >>> from romsindy import example_decay
    >>> {name: columns.shape for name, columns in implicit_data(example_decay(periods=5)).items()}
    {'x': (501, 1), 'u': (501, 2), 'x_dot': (501, 1)}
    """
    decay = decay.single()
    if decay.q_dot is None or decay.q_ddot is None:
        raise ValueError("the decay has no q_dot and q_ddot: call decay.differentiated() first")
    return {
        "x": decay.q[:, None],
        "u": np.stack([decay.q_dot, decay.q_ddot], axis=1),
        "x_dot": -decay.q_ddot[:, None],
    }
