"""Equations of motion of any number of coordinates: what all models share.

Arrays of the methods here carry R coordinates on their last axis, also where R is 1.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigh

from romsindy.notebook import shown
from romsindy.physics import export
from romsindy.physics.coupling import Along, CoupledTerm, Names
from romsindy.physics.input import Excitation, Forcing, Input, input_in
from romsindy.physics.integration import integrate_remembering, integrate_smooth, integrate_steps
from romsindy.physics.term import Term
from romsindy.physics.term_sum import TermSum, signed_text
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.recording import Quantity, checked_time
from romsindy.text import TextTable
from romsindy.typing import Array

# Near M = 0 the acceleration has no bound, and steps shrink without end; refuse before that.
SINGULAR = 1e-3


class SingularInertiaError(ValueError):
    """The inertia M(q) is not positive where the motion went.

    Examples
    --------
    >>> from romsindy import ReducedModel
    >>> model = ReducedModel.from_coefficients({"omega^2": 1.0, "Upsilon_3": -1.0})
    >>> model.simulate(1.1, 0.0, np.arange(0.0, 9.0, 0.1))  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    romsindy.physics.equations.SingularInertiaError: 1 + h(q) = -0.21 is not positive at q = 1.1 ...
    """


@dataclass(frozen=True)
class Equations(TermSum, ABC):
    """Equations of R coordinates with known coefficients; fields as of a `ReducedModel`."""

    # -- what each kind of model states -----------------------------------------------------------

    @property
    @abstractmethod
    def n_coordinates(self) -> int:
        """R."""

    @property
    @abstractmethod
    def coordinates(self) -> tuple[str, ...]:
        """Their names in equations: q, where there is one, or q1 ... qR."""

    @property
    def numbered(self) -> bool:
        """Whether terms say on which coordinates they act, as those of a `CoupledModel` do."""
        return self.coordinates != ("q",)

    @property
    @abstractmethod
    def pushes(self) -> Sequence[tuple[Input, float | Array]]:
        """Inputs, each with its coefficient: a number, or one for each of several coordinates."""

    @abstractmethod
    def residual(self, q: ArrayLike, q_dot: ArrayLike, q_ddot: ArrayLike) -> Array:
        """Left sides of the equations, (..., R): zero along a free motion."""

    @abstractmethod
    def residual_and_slopes(
        self, q: Array, q_dot: Array, q_ddot: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Residual (..., R), its derivatives by q, q_dot and q_ddot (..., R, R) at (..., R)."""

    @abstractmethod
    def stiffness(self, q: ArrayLike) -> Array:
        """Restoring forces per unit mass, (..., R)."""

    @abstractmethod
    def damping(self, q: ArrayLike, q_dot: ArrayLike) -> Array:
        """Damping forces per unit mass, (..., R)."""

    @abstractmethod
    def energy(self, q: ArrayLike, q_dot: ArrayLike) -> Array:
        """First integral of the undamped motion, per unit mass."""

    @abstractmethod
    def acceleration(self, q: ArrayLike, q_dot: ArrayLike, push: Array | float = 0.0) -> Array:
        """q_ddot under a force of inputs."""

    @abstractmethod
    def objection(self, q: Array) -> str:
        """Why no motion goes through all positions q, (n, R); empty if one may."""

    @abstractmethod
    def _state(self, q0: Any, q_dot0: Any) -> Array:
        """Start of a motion: q and q_dot, or else a ValueError."""

    @abstractmethod
    def _quick_acceleration(self) -> Callable:
        """`acceleration` of one state, which an integrator asks for 1e5 times."""

    @abstractmethod
    def _notes(self) -> dict[str, str]:
        """What is said beside coefficients, by their names."""

    # -- small vibrations -------------------------------------------------------------------------

    @cached_property
    def linear_modes(self) -> tuple[Array, Array]:
        """Of small vibrations: angular frequencies (R,), rad/s, and modes, the columns (R, R).

        Raises
        ------
        ValueError
            If q = 0 is not a stable position of rest.
        """
        self.refuse_memory("a small vibration")
        rest = np.zeros(self.n_coordinates)
        if self.objection(rest[None]):
            self._refuse(rest[None])
        _, stiffness, _, inertia = self.undamped().residual_and_slopes(rest, rest, rest)
        squared, modes = eigh((stiffness + stiffness.T) / 2, inertia)
        if not squared[0] > 0:
            raise ValueError(
                f"omega^2 = {squared[0]:.6g} is not positive: measure q from a stable position of"
                " rest"
            )
        largest = np.argmax(np.abs(modes), axis=0)
        return np.sqrt(squared), modes * np.sign(modes[largest, np.arange(len(squared))])

    @cached_property
    def linear_damping_ratios(self) -> Array:
        """Damping ratios of small vibrations in the `linear_modes`, (R,)."""
        omega, modes = self.linear_modes
        rest = np.zeros(self.n_coordinates)
        damping = self.residual_and_slopes(rest, rest, rest)[2]
        return np.einsum("ik,ij,jk->k", modes, damping, modes) / (2 * omega)

    # -- motion -----------------------------------------------------------------------------------

    @overload
    def simulate(
        self, q0: ArrayLike, q_dot0: ArrayLike, t: ArrayLike, *, rtol: float = ..., u: None = ...
    ) -> Decay: ...

    @overload
    def simulate(
        self,
        q0: ArrayLike,
        q_dot0: ArrayLike,
        t: ArrayLike,
        *,
        rtol: float = ...,
        u: Excitation,
        measured: Quantity = ...,
    ) -> ForcedVibration: ...

    def simulate(
        self,
        q0: ArrayLike,
        q_dot0: ArrayLike,
        t: ArrayLike,
        *,
        rtol: float = 1e-10,
        u: Excitation | None = None,
        measured: Quantity = "displacement",
    ) -> Decay | ForcedVibration:
        """Integrate the free motion, or that under inputs.

        Smooth models go to LSODA. With dry friction the motion of one coordinate is integrated
        stroke by stroke between reversals, and rests where friction holds it. Under inputs it is
        integrated by DOP853 from sample to sample, so that no step goes across a jump.

        Parameters
        ----------
        q0, q_dot0 : float or (R,) array
            Displacement (unit of q) and velocity (per second) at t[0]; arrays of a `CoupledModel`.
        t : (n,) array
            Increasing times in s at which the motion is wanted; uniform, as in every `Decay`.
        rtol : float
            Local relative tolerance of the integration; the error of 200 cycles is about 1e3 rtol.
        u : (n,) or (n, k) array, or callable, optional
            The inputs at the times t, a column for each source of the model, in its order.
            Between samples they go on as the `Input` says, and they act late by its delay, and
            after its lag; before the first sample they are as there. Or, without a lag, a function
            of time that gives a number, or k of them.
        measured : "displacement", "velocity" or "acceleration"
            What the y of a motion under inputs is, as a sensor of that kind shows it.

        Returns
        -------
        Decay or ForcedVibration
            Of a free motion q, q_dot and q_ddot. With ``u`` one measured quantity, (n,) or (n, R),
            and the inputs; that of one coordinate is a record as `romsindy.refine` takes it.

        Raises
        ------
        SingularInertiaError
            If the motion reaches an inertia M(q) that is not positive.
        EscapeError
            If the motion goes to infinity, or becomes too fast to be followed to the last time.
        ValueError
            For a force that jumps, of several coordinates or with ``u``: take `regularised` first.
            With ``u``, for a model without inputs, other numbers of samples or columns, or inputs
            that are constant (see `ForcedVibration`).

        Examples
        --------
        >>> from romsindy import ReducedModel
        >>> t = np.arange(0.0, 10.0, 0.01)
        >>> named = {"omega^2": 36.0, "c_linear": 0.1, "gain [force]": 2.0}
        >>> ReducedModel.from_coefficients(named, "m").simulate(0, 0, t, u=np.sin(5 * t))
        <ForcedVibration: 1000 samples at 100 Hz, 9.99 s, max |displacement| 0.3096 m, by force>
        """
        state, t = self._state(q0, q_dot0), checked_time(t)
        frequency = self._frequency_at_rest
        scale = max(np.abs(state[0]).max(), np.abs(state[1]).max() / frequency, 1e-300)
        forcing = None if u is None else self._forcing(u, t)
        if forcing is not None:
            scale = max(scale, float(np.abs(forcing(t)).max()) / frequency**2)
        if not all(term.smooth for term in self.terms):
            return self._by_strokes(state, t, rtol, scale)
        if self.memories:
            return self._remembering(state, t, rtol, scale, forcing, measured)
        if forcing is not None:
            own = self._quick_acceleration()
            q, q_dot = integrate_steps(own, state, t, forcing.steps(), rtol, scale)
            return self._shown(forcing, q, q_dot, measured)
        q, q_dot = integrate_smooth(self._quick_acceleration(), state, t, rtol, scale)
        return Decay(t, q, q_dot, self.acceleration(q, q_dot), unit=self.unit)

    @property
    def _frequency_at_rest(self) -> float:
        """Of the stiffest coordinate, rad/s; 1 where there is none: what scales a tolerance."""
        rest = np.zeros(self.n_coordinates)
        with np.errstate(all="ignore"):
            slopes = np.abs(np.diag(self.residual_and_slopes(rest, rest, rest)[1]))
        return float(np.sqrt(np.max(slopes, where=np.isfinite(slopes), initial=0.0))) or 1.0

    def _remembering(
        self,
        state: Array,
        t: Array,
        rtol: float,
        scale: float,
        forcing: Forcing | None,
        measured: Quantity,
    ) -> Decay | ForcedVibration:
        """The motion where forces remember: as from rest, or from a vibration that has lasted."""
        steps = forcing.steps() if forcing else ((end, lambda _: 0.0) for end in t[1:])
        own, rate = self._quick_acceleration(), self._frequency_at_rest
        q, q_dot, pull = integrate_remembering(
            own, self.memories, state, t, steps, rtol, scale, rate
        )
        if forcing:
            return self._shown(forcing, q, q_dot, measured, pull)
        return Decay(t, q, q_dot, self.acceleration(q, q_dot, -pull), unit=self.unit)

    def _by_strokes(self, state: Array, t: Array, rtol: float, scale: float) -> Decay:
        jumps = [term.key for term in self.terms if not term.smooth]
        raise ValueError(
            f"the force {jumps[0]} jumps: give model.regularised(velocity_scale), such as a"
            " hundredth of the largest velocity, in the place of the model"
        )

    def _forcing(self, u: Excitation, t: Array) -> Forcing:
        jumping = [term.key for term in self.terms if not term.smooth]
        if jumping:
            raise ValueError(
                f"{jumping[0]!r} jumps where the velocity changes its sign, and is not integrated"
                " under inputs: use model.regularised(velocity_scale)"
            )
        return Forcing(self.pushes, u, t)

    def _shown(
        self,
        forcing: Forcing,
        q: Array,
        q_dot: Array,
        measured: Quantity,
        pull: Array | float = 0.0,
    ) -> ForcedVibration:
        q_ddot = self.acceleration(q, q_dot, forcing(forcing.t) - pull)
        return ForcedVibration(
            forcing.t,
            {"displacement": q, "velocity": q_dot, "acceleration": q_ddot}.get(measured, q),
            forcing.u,
            unit=self.unit,
            measured=measured,
            inputs=forcing.sources,
            input_unit=forcing.inputs[0][0].input_unit,
            interpolation=forcing.interpolation,
        )

    def _refuse(self, q: Array) -> None:
        raise SingularInertiaError(
            f"{self.objection(q)} {self.unit or '[q]'}: the model has no motion there; stay at"
            " smaller amplitudes, or leave inertia terms out"
        )

    # -- text -------------------------------------------------------------------------------------

    def equations(self, precision: int = 4) -> list[str]:
        """One line of text for each equation."""
        return ["".join(parts) for parts in self._parts_of_text(precision, " = ")]

    def equation(self, precision: int = 4) -> str:
        """All equations, a line each."""
        return "\n".join(self.equations(precision))

    def latex(self, precision: int = 4) -> str:
        """LaTeX without dollar signs; of several coordinates for an ``aligned`` environment."""
        equal = " &= " if self.numbered else " = "
        lines = ["".join(p) for p in self._parts_of_text(precision, equal, latex=True)]
        return " \\\\\n".join(lines)

    def _parts_of_text(self, precision: int, equal: str, *, latex: bool = False) -> list[list[str]]:
        """Of each equation q_ddot, the terms on the left, and what drives it on the right."""
        names = self._names(latex)
        left: list[list[str]] = [[] for _ in self.coordinates]
        right = [""] * len(left)
        for term, value in self.pairs:
            driving = input_in(term)
            sign = 1 if driving is None else driving.sign
            for i, (factor, text) in _expressions(term, names).items():
                written = _in_latex(text) if latex else text
                signed = signed_text(sign * factor * value, written, precision, latex=latex)
                if driving is None:
                    left[i].append(signed)
                else:
                    right[i] += signed
        return [
            [names.q_ddot.format(i + 1), *own, f"{equal}{drive.strip().removeprefix('+ ') or '0'}"]
            for i, (own, drive) in enumerate(zip(left, right, strict=True))
        ]

    def _names(self, latex: bool) -> Names:
        n = ("_{}" if latex else "{}") if self.numbered else ""
        if latex:
            return Names(f"q{n}", rf"\dot{{{{q}}}}{n}", rf"\ddot{{{{q}}}}{n}")
        return Names(f"q{n}", f"q{n}_dot", f"q{n}_ddot")

    def formulas(self, precision: int = 4) -> list[list[str]]:
        """Each equation in LaTeX, as parts between which a line may end."""
        return self._parts_of_text(precision, " = ", latex=True)

    def _repr_latex_(self) -> str:
        return f"$$\\begin{{aligned}}\n{self.latex()}\n\\end{{aligned}}$$"

    def _repr_html_(self) -> str:
        rows = [[t.key, f"{value:.6g}", t.unit(self.unit)] for t, value in self.pairs]
        table = TextTable("", [["coefficient", "value", "unit"], *rows])
        return shown(self.formulas(), [table], [f"q in {self.unit or 'its own unit'}, t in s"])

    def __str__(self) -> str:
        lines = self.equations()
        lines[-1] += f"    (q in {self.unit or 'its own unit [q]'}, t in s)"
        notes, width = self._notes(), max([12, *(len(t.key) for t in self.terms)])
        for term, value in self.pairs:
            note, unit = notes.get(term.key, ""), term.unit(self.unit)
            lines.append(f"  {term.key:<{width}} {value:>12.6g}  {unit:<14}  {note}".rstrip())
        if self.amplitude_range is not None:
            low, high = self.amplitude_range
            lines.append(f"  from amplitudes {low:.3g} to {high:.3g} {self.unit or '[q]'}")
        return "\n".join(lines)

    # -- other programs ---------------------------------------------------------------------------

    def to_matlab(self, name: str = "rhs") -> str:
        """Text of a MATLAB or Octave function dy = name(t, y), y = [q; q_dot], for ``ode45``.

        Of several coordinates y = [q1; ...; q1_dot; ...]. With an input it is dy = name(t, y,
        force), where force is a function handle of time; delays are inside, and the comment says
        how it is called with samples.

        It belongs in a file of its name. Numbers have all their digits.

        Raises
        ------
        ValueError
            If sympy is not installed, a law of one's own has no counterpart in it, or MATLAB does
            not take the name.
        """
        return export.matlab_function(self.pairs, str(self), name, self.coordinates)

    def to_c(self, name: str = "rhs") -> str:
        """Text of a C99 function ``void name(double t, const double y[2], double dy[2])``.

        y = {q, q_dot}, or of several coordinates y = {q1, ..., q1_dot, ...}, whose M(q) must be
        positive definite, which it does not ask. With an input it is ``void name(double t, const
        double y[2], double force, double dy[2])``; the comment says at which time the value of
        force is to be taken. Numbers have all their digits; raises as `to_matlab`.
        """
        return export.c_function(self.pairs, str(self), name, self.coordinates)


def _expressions(term: Term, names: Names) -> dict[int, tuple[float, str]]:
    """A factor and text, without the coefficient, in each equation where a term stands."""
    if isinstance(term, CoupledTerm):
        return term.expressions(names)
    return {0: (1.0, term.expression(*(name.format(1) for name in names)))}


def _in_latex(text: str) -> str:
    return re.sub(r"\^(\d[\d.]+)", r"^{\1}", text).replace("sign", r"\operatorname{sign}")


Model = TypeVar("Model", bound=TermSum)


def inputs_of(model: TermSum) -> tuple[Input, ...]:
    """The inputs among the terms of a model."""
    return tuple(i for i in map(input_in, model.terms) if i is not None)


def without_inputs(model: Model) -> Model:
    """The free model."""
    return model.with_terms(pair for pair in model.pairs if input_in(pair[0]) is None)


def with_inputs(model: Any, inputs: Sequence[Input], gains: Sequence[Any]) -> Any:
    """A model that inputs drive, with the gains of each: a number, or one for each coordinate."""
    several = [
        [Along.coordinate(term, i + 1) for i in range(model.n_coordinates)]
        if model.numbered
        else [term]
        for term in inputs
    ]
    terms = (*model.terms, *(term for own in several for term in own))
    return replace(model, terms=terms, values=(*model.values, *np.ravel(gains).tolist()))


def gain_of(model: Equations) -> Any:
    """Force per unit mass for an input of 1, a number or (R,) of several coordinates; or else 1.

    Raises a ValueError if the model has several inputs, or one that lags or acts with a power.
    """
    inputs = list(dict.fromkeys(inputs_of(model)))
    if len(inputs) > 1:
        names = [term.signal for term in inputs]
        raise ValueError(f"the model has the inputs {names}, and one can be harmonic: drop others")
    changed = [term for term in inputs if term.lag or term.power > 1]
    if changed:
        raise ValueError(
            f"the model is driven by {changed[0].expression()}, which is not as large as"
            f" {changed[0].source!r} itself: drop the input, and give the force per unit mass"
        )
    return sum(gain for _, gain in model.pushes) if inputs else 1.0
