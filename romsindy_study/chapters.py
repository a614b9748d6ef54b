"""The story of the study, chapter by chapter; each is made when it is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from sklearn.base import clone

from romsindy.beam import Motion
from romsindy.record.backbone import Backbone, extract_backbone
from romsindy.record.decay import Decay
from romsindy_study import figures, tables
from romsindy_study.content import Chapter, Check, Picture
from romsindy_study.experiment import RECIPES, Trial, filtered_decay, measured_decay
from romsindy_study.harmonics import choose_harmonics
from romsindy_study.models import FAMILIES, ORDERS, identify, library
from romsindy_study.system import System
from romsindy_study.tables import Fits

_FAMILY_NOTES = {
    "stiffness": "No term of inertia; damping is left out.",
    "beam theory": "q^2 q_ddot and q q_dot^2 have coefficients of their own, beta_1 and beta_2."
    " Errors are against Upsilon_3, which both are on the static manifold.",
    "IC-ROM": "One coefficient for both inertia terms of each order, as energy conservation asks.",
}


def structure(system: System) -> Chapter:
    """The beam, its modes and its direct reduced-order models."""
    sag = float(system.beam.equilibrium().tip[1])
    return Chapter(
        "The structure",
        "A horizontal steel cantilever of 0.45 m with a pre-stretched spring at its tip, under"
        f" gravity. Its tip hangs {1e3 * -sag:.2f} mm low ({-sag / system.beam.length:.4f} of the"
        f" length). {system.beam.elements} geometrically exact elements. It is let go from a tip"
        f" displacement of a third of its length. Over {system.motion.t[-1]:g} s of free decay the"
        f" energy balance is off by {system.motion.energy.drift:.1e}.",
        [tables.frequencies(system), tables.direct(system)],
        [
            Picture(
                "modes", "Shapes and modes", "At rest, at release, and the first mode shapes.",
                partial(figures.modes, system=system), (10, 4.2),
            ),
            Picture(
                "coupling", "Modal coupling without damping",
                "Let go by a modal force. Left: the first modal coordinates, each over its largest"
                " value. Right: the others against the first; a line walked to and fro is a slave"
                " of mode 1, an area has a life of its own.",
                partial(figures.coupling, system=system), (10, 4.2),
            ),
        ],
    )  # fmt: skip


def cycles(system: System) -> Chapter:
    """The decay and what is read off it."""
    orbits = tables.normal_mode(system)
    own = np.array([row[2:] for row in orbits.rows], float)
    decay, high = np.abs(own[:, 0]).max(), np.abs(own[:, -1]).max()
    return Chapter(
        "Decay and backbone",
        f"{system.backbone!r}".strip("<>") + ". At the amplitudes of the periodic orbits of the"
        f" undamped beam, its cycles are off by {decay:.2g} % at most, and the direct model of"
        f" order 9 by {high:.2g} %.",
        [orbits],
        [
            Picture(
                "decay", "Free decay of mode 1", "With the peaks that the backbone is read from.",
                partial(figures.decay, system=system),
            ),
            Picture(
                "backbone", "Backbone and damping of the cycles",
                "Each circle is one cycle, each diamond a periodic orbit of the beam itself."
                " Curves: direct reduced-order models.",
                partial(figures.cycles, system=system), (10, 4.2),
            ),
        ],
    )  # fmt: skip


def comparison(system: System, fits: Fits) -> Chapter:
    """Stiffness polynomial, beam theory and IC-ROM by the paper's regression."""
    stiffness, icrom, high = (fits[n] for n in ("stiffness 5", "IC-ROM 5", "IC-ROM 9"))
    wrong = tables.parameter_errors(icrom.model, system.direct[5])
    omega = tables.parameter_errors(fits["IC-ROM 7"].model, system.direct[7])["omega_1"]
    damped = identify(system.decay, system.backbone, "IC-ROM", 5, damping=("linear",))
    conditions = (f"{f} {tables.condition(fits[f'{f} 3']):.3g}" for f in FAMILIES)
    pictures = [
        Picture(
            "headline", "In one picture",
            "Cycles of the decay with two models of order 5, and the errors of their backbones.",
            partial(figures.headline, system=system, candidates=[stiffness, icrom]), (10, 4.2),
        )
    ]  # fmt: skip
    for family in FAMILIES:
        panels = {
            "linear frequency estimated": [fits[f"{family} {order}"] for order in ORDERS],
            "linear frequency fixed": [fits[f"{family} {order}, omega fixed"] for order in ORDERS],
        }
        pictures.append(
            Picture(
                f"backbones_{tables.file_name(family)}",
                f"Backbones: {family}",
                "Above with the cycles, below the error; a curve ends where the model has no"
                " motion.",
                partial(figures.backbones, backbone=system.backbone, panels=panels), (10, 7.5),
            )
        )  # fmt: skip
    pictures.append(
        Picture(
            "relative_magnitude", "Relative magnitude of the terms",
            "IC-ROM of order 5 with linear damping, which the tables leave out: which terms matter"
            " at which amplitude, from the largest on.",
            partial(figures.relative_magnitude, candidate=damped, backbone=system.backbone),
        )
    )  # fmt: skip
    return Chapter(
        "Stiffness polynomial, beam theory and IC-ROM",
        "Regression as in the paper: harmonics 0 to 5, plain least squares, damping left out. At"
        f" order 5 the stiffness polynomial misses the measured frequency by"
        f" {100 * stiffness.max_error:.2f} % at most, the IC-ROM by {100 * icrom.max_error:.2f} %."
        " Condition number of the scaled regression at order 3:"
        f" {', '.join(conditions)}.",
        [
            tables.backbone_errors(fits, system),
            *(tables.family_parameters(f, fits, system, _FAMILY_NOTES[f]) for f in FAMILIES),
        ],
        pictures,
        [
            Check("stiffness polynomial of order 5, largest error of the backbone",
                  100 * stiffness.max_error, 1.0, at_most=False),
            Check("IC-ROM of order 5, largest error of the backbone", 100 * icrom.max_error, 0.25),
            Check("IC-ROM of order 9, largest error of the backbone", 100 * high.max_error, 0.06),
            Check("IC-ROM of order 5, inertia Upsilon_3 against the beam's own",
                  wrong["Upsilon_3"], 10.0),
            Check("IC-ROM of order 5, stiffness gamma_3 against the beam's own",
                  wrong["gamma_3"], 10.0),
            Check("IC-ROM of order 7, linear frequency against the beam's own", omega, 0.08),
        ],
    )  # fmt: skip


def recipes(system: System, plain: Fits, weighted: Fits) -> Chapter:
    """The paper's regression beside this package's."""
    shown = {
        "plain, harmonics 0-5": [plain["stiffness 5"], plain["IC-ROM 5"]],
        "weighted, harmonics 0-3": [weighted["stiffness 5"], weighted["IC-ROM 5"]],
    }
    return Chapter(
        "Plain and weighted regression",
        "Plain: least squares on equal rows. Weighted: `HarmonicSINDy` divides each row by the"
        " error that noise and misfit make expected in it.",
        [tables.recipes({"plain": plain, "weighted": weighted}, system)],
        [
            Picture(
                "residuals", "What the regressions leave, by harmonic",
                "Models of order 5. The tip force lets mode 2 go along with mode 1, at"
                f" {system.modes.omega[1] / system.omega:.3g} times its frequency.",
                partial(figures.residuals, recipes=shown), (10, 4.2),
            )
        ],
    )  # fmt: skip


def releases(system: System, modal: Motion) -> Chapter:
    """Release by a tip force and by a modal force."""
    decay = system.modes.project(modal)
    whole = extract_backbone(decay)
    quiet = whole.amplitude <= system.backbone.amplitude.max()
    start = float(whole.t[quiet][0] - np.pi / whole.frequency[quiet][0])
    arrays = {n: v for n, v in vars(whole).items() if isinstance(v, np.ndarray)}
    backbone = replace(whole, **{name: values[quiet] for name, values in arrays.items()})
    cases: dict[str, tuple[Decay, Backbone]] = {
        "force at the tip": (system.decay, system.backbone),
        "modal force": (decay, whole),
        "modal force, from the amplitude of the tip force on": (decay.between(start), backbone),
    }
    results = {}
    for label, (record, extracted) in cases.items():
        wanted = (("stiffness", 5), ("IC-ROM", 5), ("IC-ROM", 9))
        fits = [identify(record, extracted, *model) for model in wanted]
        results[label] = ({c.name: c for c in fits}, float(extracted.amplitude.max()))
    return Chapter(
        "Two ways to let the beam go",
        "Held by a force at its tip or by a modal force, at the same tip displacement.",
        [tables.releases(results)],
    )


def experiment(system: System, finished: Sequence[Trial], asked: int) -> Chapter:
    """The simulated experiment, for one seed and for many."""
    first = min(finished, key=lambda t: t.seed)
    noisy, filtered = (f(system.motion, first.seed) for f in (measured_decay, filtered_decay))
    clean = measured_decay(system.motion, first.seed, snr_db=None)
    models = [t.candidates["IC-ROM, plain"].model for t in finished]
    omega = [tables.parameters(model)["omega_1"] / system.omega - 1 for model in models]
    part = "" if len(finished) == asked else f" Interrupted: {len(finished)} of {asked} seeds."
    one = {name: c for name, c in first.candidates.items() if name.endswith("plain")}
    return Chapter(
        "Simulated experiment",
        "Five points, vertical and axial, 35 dB of noise on displacements and on mode shapes,"
        " three bending modes told apart by the pseudo-inverse, Butterworth filter of order 4"
        " at 100 Hz, the first 18 s. The error of a noisy mode shape scales q, and so every"
        " coefficient but omega_1, in the same way for all cycles."
        f" {len(finished)} seeds.{part}",
        [tables.spread(finished, system), tables.seeds(finished)],
        [
            Picture(
                "experiment_decay", "Mode 1 as measured", "At the start and at the end.",
                partial(figures.measurement, clean=clean, noisy=noisy, filtered=filtered), (10, 4),
            ),
            Picture(
                "experiment_backbone", "One seed: cycles and models",
                "Cycles read off the noisy decay with their standard errors; models of order 5.",
                partial(figures.experiment_backbone, noisy=noisy, candidates=one),
            ),
            Picture(
                "experiment_magnitude", "One seed: relative magnitude of the terms",
                "IC-ROM of order 5, without damping.",
                partial(
                    figures.relative_magnitude, candidate=first.candidates["IC-ROM, plain"],
                    backbone=system.backbone,
                ),
            ),
            Picture(
                "experiment_spread", "All seeds: error of the backbone",
                "Lines: median of the seeds. Bands: 5 to 95 % of them. Against the noise-free"
                " backbone.",
                partial(figures.spread, system=system, trials=finished), (9, 6),
            ),
            Picture(
                "experiment_parameters", "All seeds: parameters",
                "Errors against the direct model of order 5. Boxes hold the middle half of the"
                " seeds, with their median; whiskers reach to the last seed within 1.5 boxes,"
                " circles are seeds beyond.",
                partial(figures.parameter_spread, system=system, trials=finished), (10, 4.2),
            ),
        ],
        [
            Check(
                "noisy experiment, IC-ROM of order 5, mean error of the linear frequency"
                f" (standard deviation {100 * np.std(omega, ddof=1):.2g} %)",
                100 * float(np.mean(np.abs(omega))), 0.6,
            )
        ],
    )  # fmt: skip


def damping(system: System) -> Chapter:
    """Damping terms in the model."""
    kinds = ((), ("linear",), ("linear", "q^2 q_dot"), ("linear", "quadratic"))
    fits = {
        ", ".join(kind) or "none": identify(
            system.decay, system.backbone, "IC-ROM", 9, damping=kind
        )
        for kind in kinds
    }
    return Chapter(
        "Beyond the paper: damping in the model",
        "The paper leaves damping out of the regression and names it as future work. Here it is"
        " one more column, in the IC-ROM of order 9.",
        [tables.damping(fits, system)],
        [
            Picture(
                "damping", "Damping of cycles and models", "IC-ROM of order 9.",
                partial(figures.damping, system=system, fits=fits),
            )
        ],
    )  # fmt: skip


def harmonics(system: System, seed: int) -> Chapter:
    """Harmonics chosen by cross-validation."""
    noisy = filtered_decay(system.motion, seed)
    searches = {}
    for signal, decay in (("noise-free", system.decay), ("experiment", noisy)):
        for name, recipe in RECIPES.items():
            estimator = clone(recipe).set_params(library=library("IC-ROM", 5))
            searches[f"{signal}, {name}"] = choose_harmonics(decay, estimator, seed=seed)
    return Chapter(
        "Beyond the paper: harmonics by cross-validation",
        "How many harmonics of a cycle should the regression see?",
        [tables.harmonics(searches)],
        [
            Picture(
                "harmonics", "Error of held-out cycles", "A ring marks the choice.",
                partial(figures.harmonics, searches=searches),
            )
        ],
    )  # fmt: skip
