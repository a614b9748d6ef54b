"""Figures of the study; each function draws into an empty Figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from sklearn.model_selection import GridSearchCV

from romsindy.record.backbone import Backbone, extract_backbone
from romsindy.record.decay import Decay
from romsindy.regression.judged import Judged
from romsindy.show import plots
from romsindy.show import structure as of_structure
from romsindy.show.axes import look, with_unit
from romsindy_study.experiment import ORDER, Trial
from romsindy_study.system import System
from romsindy_study.tables import parameters

_AMPLITUDE = with_unit("amplitude", "kg^0.5 m")


def modes(figure: Figure, system: System) -> None:
    """Shapes at rest and released; mode shapes (the paper's fig. 2)."""
    left, right = figure.subplots(1, 2)
    released = system.beam.release_shape(system.beam.length / 3)
    shapes = {"equilibrium": system.beam.equilibrium(), "released": released}
    of_structure.plot_shapes(shapes, ax=left)
    of_structure.plot_modes(system.modes, ax=right)
    right.set_ylim(-6, 11)  # room for the legend


def coupling(figure: Figure, system: System) -> None:
    """Undamped modal responses, and q_2 and q_3 against q_1 (fig. 3)."""
    left, right = figure.subplots(1, 2)
    of_structure.plot_modal_responses(system.undamped, ax=left, scale=True)
    left.set(xlim=(0, 0.6), ylim=(-1.9, 1.1))  # room for the legend
    of_structure.plot_coupling(system.undamped, ax=right)


def decay(figure: Figure, system: System) -> None:
    """The decay of mode 1 with its peaks (fig. 4)."""
    plots.plot_decay(system.decay, system.backbone, ax=figure.subplots())


def cycles(figure: Figure, system: System) -> None:
    """Backbone and damping of the cycles (fig. 5), with direct reduced-order models."""
    left, right = figure.subplots(1, 2)
    models = {f"direct, order {o}": system.direct[o] for o in (5, 9)}
    plots.plot_backbone(system.backbone, models, ax=left)
    of_structure.plot_normal_mode(system.normal_mode, left)
    plots.plot_damping(system.backbone, ax=right)


def backbones(figure: Figure, backbone: Backbone, panels: Mapping[str, Sequence[Judged]]) -> None:
    """Backbones of models above, their errors below; one column a panel (figs. 6 to 10)."""
    axes = figure.subplots(2, len(panels), squeeze=False)
    for (title, candidates), (top, bottom) in zip(panels.items(), axes.T, strict=True):
        models = {c.name.removesuffix(", omega fixed"): c.model for c in candidates}
        plots.plot_backbone(backbone, models, ax=top)
        top.set_title(title, fontsize="medium")
        errors(bottom, backbone, candidates)


def errors(ax: Axes, backbone: Backbone, candidates: Sequence[Judged]) -> None:
    """Absolute relative frequency error of models against amplitude, %."""
    for i, c in enumerate(candidates):
        ax.plot(backbone.amplitude, 100 * np.abs(c.error), **look(i), lw=1.2)
    ax.set(xlabel=_AMPLITUDE, ylabel="frequency error (%)", yscale="log", ylim=(1e-3, 10))
    ax.grid(axis="y", color="0.9")


def headline(figure: Figure, system: System, candidates: Sequence[Judged]) -> None:
    """Cycles and two models on the left, their errors on the right."""
    left, right = figure.subplots(1, 2, width_ratios=(1.15, 1))
    names = {c.name.replace(" 5", ", order 5"): c.model for c in candidates}
    plots.plot_backbone(system.backbone, names, ax=left)
    of_structure.plot_normal_mode(system.normal_mode, left)
    errors(right, system.backbone, candidates)


def relative_magnitude(figure: Figure, candidate: Judged, backbone: Backbone) -> None:
    """Rms of the terms relative to the acceleration (figs. 11 and 14)."""
    top = float(backbone.amplitude.max())
    amplitudes = np.linspace(0.02 * top, top, 120)
    plots.plot_relative_magnitude(candidate.model, amplitudes, ax=figure.subplots())


def residuals(figure: Figure, recipes: Mapping[str, Sequence[Judged]]) -> None:
    """Residual by harmonic of models of order 5, one panel a recipe."""
    axes = np.atleast_1d(figure.subplots(1, len(recipes), sharey=True))
    for ax, (title, candidates) in zip(axes, recipes.items(), strict=True):
        plots.plot_residual({c.name: c.estimator for c in candidates}, ax=ax)
        ax.set_title(title, fontsize="medium")


def measurement(figure: Figure, clean: Decay, noisy: Decay, filtered: Decay) -> None:
    """Mode 1 of the simulated experiment at the start and at the end (fig. 12)."""
    axes = figure.subplots(1, 2)
    for ax, start in zip(axes, (0.0, float(noisy.t[-1]) - 0.6), strict=True):
        for signal, label, style in (
            (noisy, "measured", {"color": "0.75", "lw": 1.0}),
            (filtered, "filtered", {"color": "C0", "lw": 1.2}),
            (clean, "noise-free", {"color": "k", "lw": 0.9, "ls": "--"}),
        ):
            part = signal.between(start, start + 0.6)
            ax.plot(part.t, part.q, label=label, **style)
        ax.set(xlabel="time (s)", ylabel=with_unit("q", noisy.unit))
        ax.margins(x=0)
    axes[1].legend(loc="lower right", ncols=3, frameon=False, fontsize="small")
    low, high = axes[1].get_ylim()
    axes[1].set_ylim(low - 0.2 * (high - low), high)


def experiment_backbone(figure: Figure, noisy: Decay, candidates: Mapping[str, Judged]) -> None:
    """Cycles of one noisy decay with the models identified from it (fig. 13)."""
    models = {name: c.model for name, c in candidates.items()}
    plots.plot_backbone(extract_backbone(noisy), models, ax=figure.subplots())


def spread(figure: Figure, system: System, trials: Sequence[Trial]) -> None:
    """Median and 5 to 95 % of the backbone error over seeds (fig. 15, with its spread)."""
    order = np.argsort(system.backbone.amplitude)
    amplitude = system.backbone.amplitude[order]
    axes = figure.subplots(2, 2, sharex=True, sharey=True)
    for i, (name, ax) in enumerate(zip(trials[0].candidates, axes.flat, strict=True)):
        error = 100 * np.array([t.candidates[name].error for t in trials])[:, order]
        low, middle, high = np.nanquantile(error, (0.05, 0.5, 0.95), axis=0)
        ax.fill_between(amplitude, low, high, color=f"C{i}", alpha=0.3, lw=0)
        ax.plot(amplitude, middle, color=f"C{i}")
        ax.axhline(0, color="0.5", lw=0.7)
        ax.set_title(name, fontsize="medium")
    figure.supxlabel(_AMPLITUDE, fontsize="medium")
    figure.supylabel("frequency error (%)", fontsize="medium")


def parameter_spread(figure: Figure, system: System, trials: Sequence[Trial]) -> None:
    """Signed errors of omega_1, gamma_3 and Upsilon_3 over seeds, one box a model."""
    truth = parameters(system.direct[ORDER])
    labels = {"omega_1": r"$\omega_1$", "gamma_3": r"$\gamma_3$", "Upsilon_3": r"$\Upsilon_3$"}
    for ax, (key, label) in zip(figure.subplots(1, 3), labels.items(), strict=True):
        errors = {}
        for name in trials[0].candidates:
            found = [parameters(t.candidates[name].model).get(key) for t in trials]
            if None not in found:
                errors[name.replace(", ", "\n")] = 100 * (np.array(found) / truth[key] - 1)
        ax.boxplot(list(errors.values()), widths=0.6)
        ax.set_xticklabels(list(errors), fontsize="x-small")
        ax.axhline(0, color="0.5", lw=0.7)
        ax.set(title=label, ylabel="error (%)")


def damping(figure: Figure, system: System, fits: Mapping[str, Judged]) -> None:
    """Damping ratio of the cycles and of models with damping terms."""
    models = {name: c.model for name, c in fits.items() if name != "none"}
    ax = plots.plot_damping(system.backbone, models, ax=figure.subplots())
    ratio = 100 * system.backbone.damping_ratio
    ax.set_ylim(0.95 * ratio.min(), 1.05 * ratio.max())


def harmonics(figure: Figure, searches: Mapping[str, GridSearchCV]) -> None:
    """Cross-validated frequency error against the highest harmonic."""
    ax = figure.subplots()
    for i, (name, search) in enumerate(searches.items()):
        highest = [p["projection__harmonics"][-1] for p in search.cv_results_["params"]]
        score = -100 * search.cv_results_["mean_test_score"]
        ax.plot(highest, score, marker="o", **look(i), label=name, ms=4)
        best = search.best_index_
        ax.plot(highest[best], score[best], "o", color=f"C{i}", ms=9, mfc="none")
    ax.set(xlabel="highest harmonic", ylabel="error of held-out cycles (%)", yscale="log")
    ax.legend(frameon=False, fontsize="small")
