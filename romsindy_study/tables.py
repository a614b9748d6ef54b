"""Tables of the study, from models to rows."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from sklearn.model_selection import GridSearchCV

from romsindy.physics.model import ReducedModel
from romsindy.regression.judged import Judged
from romsindy_study.content import Cell, Table
from romsindy_study.experiment import Trial
from romsindy_study.models import FAMILIES, ORDERS
from romsindy_study.system import System

Fits = Mapping[str, Judged]


def file_name(family: str) -> str:
    """A family's name as a part of names of files."""
    return family.lower().replace(" ", "_").replace("-", "")


def parameters(model: ReducedModel) -> dict[str, float]:
    """Coefficients by name, with omega_1 (rad/s) in the place of omega^2."""
    values = dict(model.coefficients)
    return {"omega_1": float(np.sqrt(values.pop("omega^2"))), **values}


def parameter_errors(model: ReducedModel, direct: ReducedModel) -> dict[str, float]:
    """Error in % of every identified parameter relative to the direct one, eq. (20).

    Both coefficients of beam theory are held against Upsilon_3, which they are on the static
    manifold. Damping has no direct value and is left out.
    """
    truth = parameters(direct)
    truth |= {"beta_1": truth["Upsilon_3"], "beta_2": truth["Upsilon_3"]}
    return {
        name: 100 * abs(value / truth[name] - 1)
        for name, value in parameters(model).items()
        if name in truth
    }


def frequencies(system: System) -> Table:
    """Linear frequencies beside those that the paper prints."""
    printed = (38.5, 165.9, None)
    return Table(
        "frequencies",
        "Linear frequencies",
        "About the sagged equilibrium. The paper prints them; its spring and section are not"
        " printed, and the defaults of the beam are the parameters that reproduce these numbers.",
        ["", "rad/s", "in the paper, rad/s"],
        [[f"mode {i + 1}", float(system.modes.omega[i]), printed[i]] for i in range(3)],
    )


def direct(system: System) -> Table:
    """Coefficients of the direct reduced-order models."""
    names = list(system.direct[ORDERS[-1]].coefficients)
    found = {order: model.coefficients for order, model in system.direct.items()}
    return Table(
        "direct_parameters",
        "Direct reduced-order parameters: what identification is held against",
        "Least squares over static cases within the amplitudes of the decay. The coefficients"
        " depend on the order, because a polynomial stands in for a spring whose own length is"
        " shorter than the motion: each model is held against the direct one of its order.",
        ["coefficient (SI units)", *(f"order {order}" for order in ORDERS)],
        [[name, *(found[order].get(name) for order in ORDERS)] for name in names],
    )


def normal_mode(system: System) -> Table:
    """The beam's own backbone beside that of the decay and of the direct models."""
    mode, backbone = system.normal_mode, system.backbone
    order = np.argsort(backbone.amplitude)
    cycles = np.interp(mode.amplitude, backbone.amplitude[order], backbone.frequency[order])
    columns = [cycles, *(m.backbone(mode.amplitude) for m in system.direct.values())]
    off = [100 * (column / mode.frequency - 1) for column in columns]
    return Table(
        "normal_mode",
        "Periodic orbits of the beam itself",
        "Found by shooting on the finite elements, without damping. Relative deviation from them,"
        " %, of the cycles of the decay and of the direct reduced-order models.",
        ["amplitude, kg^0.5 m", "rad/s", "cycles", *(f"direct, order {o}" for o in system.direct)],
        np.stack([mode.amplitude, mode.frequency, *off], axis=1).tolist(),
    )


def backbone_errors(fits: Fits, system: System) -> Table:
    """Error of the backbone and of the linear frequency for every model."""
    rows: list[list[Cell]] = []
    for family, order in itertools.product(FAMILIES, ORDERS):
        pair = [fits[f"{family} {order}{suffix}"] for suffix in ("", ", omega fixed")]
        omega = parameters(pair[0].model)["omega_1"]
        row = [100 * (omega / system.omega - 1)]
        row += [100 * e for c in pair for e in (c.max_error, c.rms_error)]
        rows.append([family, float(order), *row, *(float(c.lost) for c in pair)])
    return Table(
        "backbone_errors",
        "Backbone errors of all models",
        f"Relative frequency error over the {len(system.backbone)} cycles, % ; the linear"
        f" frequency estimated, or fixed to the true {system.omega:.5g} rad/s. 'No motion': the"
        " model has no periodic motion at the amplitudes of as many cycles as are lost.",
        [
            "family", "order", "omega_1 error, %", "max, estimated", "rms, estimated",
            "max, fixed", "rms, fixed", "cycles lost, estimated", "cycles lost, fixed",
        ],
        rows,
    )  # fmt: skip


def family_parameters(family: str, fits: Fits, system: System, note: str) -> Table:
    """Relative errors of the parameters of one family (the paper's tables 2 to 4)."""
    columns = {}
    for order, (suffix, label) in itertools.product(
        ORDERS, (("", "est."), (", omega fixed", "fixed"))
    ):
        model = fits[f"{family} {order}{suffix}"].model
        columns[f"order {order}, {label}"] = parameter_errors(model, system.direct[order])
    names = sorted(
        set().union(*columns.values()),
        key=lambda name: ("omega_1" not in name, name.split("_")[0], name),
    )
    return Table(
        f"parameters_{file_name(family)}",
        f"Relative errors of the parameters, %: {family}",
        note,
        ["parameter", *columns],
        [[name, *(column.get(name) for column in columns.values())] for name in names],
    )


def condition(candidate: Judged) -> float:
    """Condition number of the regression's columns, scaled to rms 1."""
    theta = candidate.estimator.rows_.theta
    return float(np.linalg.cond(theta / np.sqrt(np.mean(theta**2, axis=0))))


def recipes(fits: Mapping[str, Fits], system: System) -> Table:
    """Plain and weighted regression side by side."""
    rows: list[list[Cell]] = []
    compared = ("omega_1", "gamma_3", "Upsilon_3")
    for recipe, family, order in itertools.product(fits, ("stiffness", "IC-ROM"), ORDERS):
        c = fits[recipe][f"{family} {order}"]
        errors = parameter_errors(c.model, system.direct[order])
        row = [100 * c.max_error, 100 * c.rms_error, *(errors.get(name) for name in compared)]
        rows.append([recipe, family, float(order), *row])
    return Table(
        "recipes",
        "The paper's plain regression and this package's weighted one",
        "Linear frequency estimated, errors in %. The weighted regression counts the third harmonic"
        " for 1/81 of the first, as noise of a displacement sensor calls for.",
        ["regression", "family", "order", "max", "rms", *compared],
        rows,
    )


def spread(trials: Sequence[Trial], system: System) -> Table:
    """Mean and standard deviation over seeds."""
    truth = system.direct[5].coefficients
    rows: list[list[Cell]] = []
    for name in trials[0].candidates:
        found = [t.candidates[name] for t in trials]
        omega = np.array([parameters(c.model)["omega_1"] for c in found]) / system.omega - 1
        columns: list[np.ndarray | None] = [omega, np.array([c.max_error for c in found])]
        for key in ("gamma_3", "Upsilon_3"):
            values = [c.model.coefficients.get(key) for c in found]
            columns.append(None if None in values else np.array(values, float) / truth[key] - 1)
        rows.append([name, *(cell for column in columns for cell in _mean_and_deviation(column))])
    return Table(
        "experiment",
        f"Simulated experiment, order 5, linear frequency estimated, {len(trials)} seeds",
        "Relative errors in %, mean and standard deviation over the seeds; signed, but for the"
        " largest backbone error. The backbone is held against that of the noise-free decay.",
        [
            "model", "omega_1", "sd", "backbone, max", "sd", "gamma_3", "sd", "Upsilon_3", "sd",
        ],
        rows,
    )  # fmt: skip


def _mean_and_deviation(errors: np.ndarray | None) -> list[Cell]:
    if errors is None:
        return [None, None]
    return [100 * float(errors.mean()), 100 * float(errors.std(ddof=1))]


def seeds(trials: Sequence[Trial]) -> Table:
    """Every seed and model: parameters and backbone error."""
    found = [
        (str(t.seed), model, 100 * c.max_error, parameters(c.model))
        for t in sorted(trials, key=lambda t: t.seed)
        for model, c in t.candidates.items()
    ]
    names = list(dict.fromkeys(name for *_, values in found for name in values))
    rows = [[s, m, e, *(values.get(name) for name in names)] for s, m, e, values in found]
    return Table(
        "experiment_seeds", "", "", ["seed", "model", "max backbone error, %", *names], rows
    )


def damping(fits: Fits, system: System) -> Table:
    """Models with damping terms held against the damping of the cycles."""
    measured = system.backbone.damping_ratio
    rows: list[list[Cell]] = []
    for name, c in fits.items():
        error = c.model.damping_ratio(system.backbone.amplitude) / measured - 1
        errors = (c.max_error, float(np.abs(error).max()), float(np.sqrt(np.mean(error**2))))
        found = [c.model.coefficients.get(f"c_{k}") for k in ("linear", "q^2 q_dot", "quadratic")]
        rows.append([name, *(100 * e for e in errors), *found])
    return Table(
        "damping",
        "Damping terms in the model",
        "Errors in %, of the backbone and of the damping ratio of each cycle. The structure has"
        f" Rayleigh damping, {system.beam.alpha:g} + {system.beam.eta:g} omega^2 ="
        f" {system.beam.alpha + system.beam.eta * system.omega**2:.4g} 1/s for mode 1.",
        [
            "IC-ROM with damping", "backbone, max", "damping, max", "damping, rms",
            "c_linear, 1/s", "c_q^2 q_dot, 1/(kg m^2 s)", "c_quadratic, 1/(kg^0.5 m)",
        ],
        rows,
    )  # fmt: skip


def harmonics(searches: Mapping[str, GridSearchCV]) -> Table:
    """Cross-validated frequency error by harmonics."""
    first = next(iter(searches.values()))
    choices = [p["projection__harmonics"] for p in first.cv_results_["params"]]
    scores = [-100 * s.cv_results_["mean_test_score"] for s in searches.values()]
    best = {k: s.best_params_["projection__harmonics"][-1] for k, s in searches.items()}
    chosen = "; ".join(f"{name}: 0 to {top}" for name, top in best.items())
    return Table(
        "harmonics",
        "Harmonics chosen by cross-validation over cycles",
        "Rms relative error, %, of the frequency of held-out cycles (four folds of blocks of 12"
        " cycles), IC-ROM of order 5; 100 % stands for a cycle at whose amplitude the model has"
        f" no motion. Chosen: {chosen}.",
        ["harmonics", *searches],
        [[f"0 to {h[-1]}", *(float(s[i]) for s in scores)] for i, h in enumerate(choices)],
    )


def releases(results: Mapping[str, tuple[Fits, float]]) -> Table:
    """Backbone errors by release and amplitude."""
    names = ["stiffness 5", "IC-ROM 5", "IC-ROM 9"]
    return Table(
        "releases",
        "How the beam is let go",
        "Largest backbone error, %, linear frequency estimated, plain regression. A modal force"
        " that holds the same tip displacement lets mode 1 go at a larger q; the last line leaves"
        " those loud cycles out.",
        ["release", "largest amplitude, kg^0.5 m", *names],
        [
            [label, top, *(100 * fits[n].max_error for n in names)]
            for label, (fits, top) in results.items()
        ],
    )
