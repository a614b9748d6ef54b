"""Equations for other programs say what the model says."""

import json
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import sympy
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from test_coupled import COUPLED
from test_physics_laws import ALL, COMBINED, Ripple

from romsindy import CoupledModel, ReducedModel
from romsindy.physics.coupling import Along
from romsindy.physics.damping import Friction, PositionDamping
from romsindy.physics.example import EXAMPLE_MODEL
from romsindy.physics.export import auto_function, symbols
from romsindy.physics.input import Input
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import ForceLaw

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
import exports

sys.path.pop(0)

Q, Q_DOT = np.random.default_rng(5).uniform(-0.9, 0.9, (2, 400))
LAWS = [*ALL, COMBINED, Friction(creep=0.3), Friction(1.05, 0.2), PositionDamping(3), Ripple(1 / 3)]
# Every law beside a soft spring; a third has no short decimals.
MODELS = [ReducedModel((Stiffness(1.5), law), (1 / 7, 1 / 3)) for law in LAWS]
needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
needs_octave = pytest.mark.skipif(shutil.which("octave-cli") is None, reason="there is no Octave")


def evaluated(expression):
    return sympy.lambdify(sympy.symbols("q q_dot", real=True), expression, "numpy")(Q, Q_DOT)


@pytest.mark.parametrize("model", MODELS, ids=lambda m: m.terms[-1].key)
def test_sympy_accelerates_as_the_model_does(model):
    forces = np.abs(model.stiffness(Q)) + np.abs(model.damping(Q, Q_DOT)) + 1
    error = np.abs(evaluated(model.to_sympy()) - model.acceleration(Q, Q_DOT))
    # Powers of both by different routes: some units in the last place of the forces.
    assert np.max(error / forces) < 1e-14


@pytest.mark.parametrize("model", MODELS, ids=lambda m: m.terms[-1].key)
def test_matlab_accelerates_as_the_model_does(model):
    """Its statements read as Python: arrays, and functions of the same names."""
    text = model.to_matlab()
    assert text.startswith("function dy = rhs(t, y)\n%") and text.endswith("\nend")
    body = re.sub(r" \.\.\.\n *", " ", text.split("\n", 1)[1].rsplit("\n", 1)[0])
    body = "\n".join(line for line in body.splitlines() if not line.startswith("%"))
    for matlab, python in (
        (".^", "**"),
        (".*", "*"),
        ("./", "/"),
        ("; -", ", -"),
        ("y(", "y("),
        (";", ""),
    ):
        body = body.replace(matlab, python)
    names = {"y": (None, Q, Q_DOT).__getitem__, "max": np.maximum}
    names |= {name: getattr(np, name) for name in ("abs", "sign", "sin", "tanh")}
    exec(body, names)
    np.testing.assert_array_equal(names["dy"][0], Q_DOT)
    scale = np.abs(model.stiffness(Q)) + np.abs(model.damping(Q, Q_DOT)) + 1
    assert np.max(np.abs(names["dy"][1] - model.acceleration(Q, Q_DOT)) / scale) < 1e-14


# -- several coordinates --------------------------------------------------------------------------

# Christoffel forces, inertia and damping across coordinates, kinks, dry friction, other masses.
EVERYTHING = {
    **COUPLED.coefficients,
    "gamma_|q|^2 [q1 - q2]": -0.7,
    "c_coulomb [q1 + 0.3 q2]": 1 / 7,
    "mu [q2]": 0.4,
    "c_|q|^1.5 q_dot [q2]": 0.2,
    "C_12 q1 q2": 0.3,
}
SEVERAL = {
    "everything": EVERYTHING,
    "three": {**EVERYTHING, "omega^2 [q3]": 90.0, "V q1 q2 q3": 2.0, "g(q1 q3) g(q2^2)": 0.04},
    "undamped": {"omega^2 [q1]": 4.0, "omega^2 [q2]": 9.0, "V q1^2 q2": 1 / 3},
}
each_of_several = pytest.mark.parametrize("title", SEVERAL)


def several(title):
    """A model, states of it with coordinates last, (400, R), and its accelerations."""
    model = CoupledModel.from_coefficients(SEVERAL[title], unit="m")
    states = np.random.default_rng(6).uniform(-0.5, 0.5, (2, 400, model.n_coordinates))
    return model, *states, model.acceleration(*states)


def solved(inertia, force):
    """q_ddot (n, R) of M (R, R, n) and the forces (R, n)."""
    return -np.linalg.solve(np.moveaxis(inertia, -1, 0), np.transpose(force)[..., None])[..., 0]


def filled(matrix, state):
    """The entries of a sympy matrix at states (n, 2 R), (rows, columns, n)."""
    coordinates = tuple(f"q{i + 1}" for i in range(state.shape[1] // 2))
    names = [x for several in symbols(coordinates) for x in several]
    entries = [sympy.lambdify(names, x, "numpy")(*state.T) for x in matrix]
    return np.stack(np.broadcast_arrays(*entries, state[:, 0])[:-1]).reshape(*matrix.shape, -1)


@each_of_several
def test_sympy_accelerates_as_several_coordinates_do(title):
    model, q, q_dot, expected = several(title)
    inertia, force = (filled(x, np.hstack([q, q_dot])) for x in model.to_sympy())
    assert_allclose(inertia, np.moveaxis(model.inertia(q), 0, -1), atol=1e-14)
    # M is well conditioned: rounding of some twenty products, of forces up to 100.
    error = np.abs(solved(inertia, force[:, 0]) - expected)
    assert np.max(error) < 1e-12 * np.max(np.abs(expected))


@needs_compiler
@each_of_several
def test_compiled_c_accelerates_as_several_coordinates_do(title, tmp_path):
    model, q, q_dot, expected = several(title)
    rates = exports.compiled(model, tmp_path)
    found = np.array([rates(0.0, y) for y in np.hstack([q, q_dot])])
    np.testing.assert_array_equal(found[:, : q.shape[1]], q_dot)
    error = np.abs(found[:, q.shape[1] :] - expected)
    assert np.max(error) < 1e-12 * np.max(np.abs(expected))


@each_of_several
def test_matlab_accelerates_as_several_coordinates_do(title):
    """Its statements read as Python, but for the last one, which solves."""
    model, q, q_dot, expected = several(title)
    r, text = model.n_coordinates, model.to_matlab()
    assert text.startswith("function dy = rhs(t, y)\n%")
    assert text.endswith(f"dy = [y({r + 1}:{2 * r}); -(inertia \\ force)];\nend")
    body = re.sub(r" \.\.\.\n *", " ", text.split("\n", 1)[1].rsplit("\n", 2)[0])
    body = "\n".join(line for line in body.splitlines() if not line.startswith("%"))
    body = re.sub(r"^(inertia|force)\(([\d, ]+)\) =", r"\1[at(\2)] =", body, flags=re.M)
    body = body.replace(".^", "**").replace(".*", "*").replace("./", "/").replace(";", "")
    names = {"y": lambda k: np.hstack([q, q_dot])[:, k - 1], "max": np.maximum}
    names |= {"at": lambda *k: tuple(i - 1 for i in k), "abs": np.abs, "sign": np.sign}
    names["zeros"] = lambda n, m: np.zeros((n, m, len(q))[:: 2 if m == 1 else 1])
    exec(body, names)
    error = np.abs(solved(names["inertia"], names["force"]) - expected)
    assert np.max(error) < 1e-12 * np.max(np.abs(expected))


def test_text_of_several_coordinates_says_equations_units_and_jumps():
    model = several("everything")[0]
    for text in (model.to_c("roll"), model.to_matlab("roll")):
        said = re.sub(r"\n(//|%) ", " ", text)
        assert "q2_ddot + 150 q2" in said and "(q in m, t in s)" in said
        assert "1/(m^2 s)" in said and "roll(" in said and "jumps where q_dot" in said
        assert max(map(len, text.splitlines())) < 110
    assert "jumps" not in model.regularised(0.1).to_c()
    with pytest.raises(ValueError, match="name='q1_dot' is a word of C or MATLAB"):
        model.to_c("q1_dot")


def test_laws_of_several_coordinates_that_cannot_be_exported_are_named():
    stepping = Along.coordinate(Stepping("ufunc"), 2)
    model = CoupledModel((Along.coordinate(Stiffness(1), 1), stepping), (1.0, 1.0))
    with pytest.raises(ValueError, match=r"'stepping' cannot be exported \(numpy.heaviside"):
        model.to_matlab()


# -- one coordinate in motion ---------------------------------------------------------------------


@needs_compiler
@pytest.mark.parametrize("title", exports.SMOOTH)
def test_compiled_c_moves_as_the_model_does(title, tmp_path):
    """The exported function in scipy's integrator against `simulate`, which is LSODA."""
    model = exports.SMOOTH[title]
    # What the issue asks for; measured are some 1e-11.
    assert exports.error(model, exports.moved_in_c(model, tmp_path)) < 1e-8


@needs_octave
@pytest.mark.parametrize("title", exports.SMOOTH)
def test_octave_moves_as_the_model_does(title, tmp_path):
    model = exports.SMOOTH[title]
    assert exports.error(model, exports.moved_in_octave(model, tmp_path)) < 1e-8


def test_text_says_equation_units_and_jumps():
    model = ReducedModel.from_coefficients({"omega^2": 36.0, "c_coulomb": 0.2}, unit="m")
    for text in (model.to_c("roll"), model.to_matlab("roll")):
        assert "q_ddot + 36 q + 0.2 sign(q_dot) = 0    (q in m, t in s)" in text
        assert "m/s^2" in text and "roll(" in text and "jumps where q_dot" in text
        assert max(map(len, text.splitlines())) < 110
    assert "jumps" not in model.regularised(0.1).to_c()


@pytest.mark.parametrize("name", ["", "7up", "my-model", "rück"])
def test_names_of_functions_are_checked(name):
    for write in (EXAMPLE_MODEL.to_c, EXAMPLE_MODEL.to_matlab):
        with pytest.raises(ValueError, match=r"name=.* names no function: begin with a letter"):
            write(name)


@pytest.mark.parametrize("name", ["for", "end", "double", "q_dot"])
def test_functions_are_not_named_as_words_of_their_language(name):
    for write in (EXAMPLE_MODEL.to_c, EXAMPLE_MODEL.to_matlab):
        with pytest.raises(ValueError, match=f"name='{name}' is a word of C or MATLAB"):
            write(name)


@dataclass(frozen=True)
class Stepping(ForceLaw):
    """Laws that sympy cannot follow."""

    way: str

    dimension = (0, 0)
    key = "stepping"

    def expression(self, q="q", q_dot="q_dot", q_ddot="q_ddot"):
        return "step"

    def stiffness(self, q):
        if self.way == "ufunc":
            return np.heaviside(q, 0.0)
        if self.way == "function":
            return np.interp(q, [-1, 1], [-1, 1])
        return 1.0 if q > 0 else 0.0


@pytest.mark.parametrize(
    ("way", "reason"), [("ufunc", "numpy.heaviside"), ("function", "numpy.interp"), ("if", "")]
)
def test_what_cannot_be_exported_is_named(way, reason):
    model = ReducedModel((Stiffness(1), Stepping(way)), (1.0, 1.0))
    with pytest.raises(ValueError, match=rf"'stepping' cannot be exported \({reason}.*leave the"):
        model.to_sympy()


def test_without_sympy_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "sympy", None)
    with pytest.raises(ValueError, match=r'python -m pip install "romsindy\[export\]"$'):
        EXAMPLE_MODEL.to_c()


# -- inputs ---------------------------------------------------------------------------------------

INPUTS = (
    Input("force", delay=1 / 300),
    Input("base", "hold", -0.25),
    Input("force 2", "linear", lag=0.125),
    Input("force", delay=0.5, power=3),
)
DRIVEN = ReducedModel(
    (*EXAMPLE_MODEL.terms, *INPUTS), (*EXAMPLE_MODEL.values, 1 / 7, 2.0, -0.3, 0.4), "m"
)
NOW = 0.7


def pushes(t):
    """Some functions of time, by name."""
    return {"force": np.cos(3 * t), "base": np.sin(5 * t), "force_2": t**2}


def driven_acceleration():
    """By the laws, at states and NOW."""
    pushed = pushes(NOW - 1 / 300)["force"] / 7 - 2 * pushes(NOW + 0.25)["base"]
    pushed += 0.4 * pushes(NOW - 0.5)["force"] ** 3 - 0.3 * pushes(NOW)["force_2"]
    return EXAMPLE_MODEL.acceleration(Q, Q_DOT) + pushed / EXAMPLE_MODEL.inertia(Q)


def functions():
    return {name: lambda t, name=name: pushes(t)[name] for name in pushes(NOW)}


def evaluated_driven(expression):
    names = [*sympy.symbols("q q_dot t", real=True)]
    return sympy.lambdify(names, expression, [functions(), "numpy"])(Q, Q_DOT, NOW)


def test_sympy_accelerates_under_inputs():
    assert_allclose(evaluated_driven(DRIVEN.to_sympy()), driven_acceleration(), atol=1e-13)


def test_matlab_accelerates_under_inputs():
    text = DRIVEN.to_matlab("pushed")
    assert text.startswith("function dy = pushed(t, y, force, base, force_2)\n%")
    said = re.sub(r"\n% ", " ", text)
    assert "@(t, y) pushed(t, y, @(s) interp1(tu, u(:, 1), s, 'spline', 'extrap')" in said
    assert "@(s) interp1(tu, u(:, 2), s, 'previous', 'extrap')" in said
    assert "In the place of force_2 stands x, 0.125 dx/dt + x = force_2: its samples are" in said
    body = re.sub(r" \.\.\.\n *", " ", text.split("\n", 1)[1].rsplit("\n", 1)[0])
    body = "\n".join(line for line in body.splitlines() if not line.startswith("%"))
    for matlab, python in ((".^", "**"), (".*", "*"), ("./", "/"), ("; -", ", -"), (";", "")):
        body = body.replace(matlab, python)
    names = {"y": (None, Q, Q_DOT).__getitem__, "t": NOW, **functions()}
    exec(body, names)
    assert_allclose(names["dy"][1], driven_acceleration(), atol=1e-13)


@needs_compiler
def test_compiled_c_accelerates_under_inputs(tmp_path):
    text = DRIVEN.to_c()
    arguments = "double t, const double y[2], double force, double base, double force_2,"
    said = re.sub(r"\n(// |\s*)", " ", text)
    assert f"void rhs({arguments} double force_power_3, double dy[2])" in said
    assert "The argument force_power_3 is force(t - 0.5)^3." in said
    assert "The argument base is base(t + 0.25)." in said
    rates = exports.compiled(DRIVEN, tmp_path)
    values = [pushes(NOW - 1 / 300)["force"], pushes(NOW + 0.25)["base"]]
    values += [pushes(NOW)["force_2"], pushes(NOW - 0.5)["force"] ** 3]
    found = np.array([rates(NOW, y, *values) for y in np.stack([Q, Q_DOT], axis=1)])
    assert_allclose(found[:, 1], driven_acceleration(), atol=1e-13)


@needs_compiler
def test_compiled_c_moves_under_an_input_as_the_model_does(tmp_path):
    model = ReducedModel((*EXAMPLE_MODEL.terms, INPUTS[0]), (*EXAMPLE_MODEL.values, 2.0), "m")
    rates, t = exports.compiled(model, tmp_path), np.linspace(0, 10, 1001)
    found = solve_ivp(
        lambda now, y: rates(now, y, np.cos(3 * (now - 1 / 300))),
        t[[0, -1]],
        (0.3, 0.0),
        "DOP853",
        t,
        rtol=1e-12,
        atol=1e-13,
    ).y[0]
    same = model.simulate(0.3, 0.0, t, u=lambda now: np.cos(3 * now), rtol=1e-12).y
    assert np.abs(found - same).max() < 1e-8 * np.abs(same).max()


def test_one_input_goes_by_samples():
    model = ReducedModel((Stiffness(1), Input("force")), (36.0, 2.0), "m")
    said = re.sub(r"\n% ", " ", model.to_matlab())
    assert "ode45(@(t, y) rhs(t, y, @(s) interp1(tu, u, s, 'spline', 'extrap')), [t0 t1]" in said
    lagging = ReducedModel((Stiffness(1), Input("force", "hold", lag=0.1)), (36.0, 2.0), "m")
    assert "interp1(tu, u, s, 'linear', 'extrap')" in re.sub(r"\n% ", " ", lagging.to_matlab())
    for name in ("forces", "base", "force_2"):
        with pytest.raises(ValueError, match="is a word of C or MATLAB"):
            model.to_c(name)


def test_command_exports_inputs(run, tmp_path):
    (tmp_path / "model.json").write_text(DRIVEN.to_json())
    names = {}
    exec(run("model.json", "--to", "sympy").output, names)
    assert_allclose(evaluated_driven(names["q_ddot"]), driven_acceleration(), atol=1e-13)
    assert run("model.json", "--to", "c").output == DRIVEN.to_c() + "\n"
    assert run("model.json", "--to", "matlab").output == DRIVEN.to_matlab() + "\n"
    assert "inputs" in run("--help").output


# -- the command --------------------------------------------------------------------------------


@pytest.fixture
def run(run):
    return partial(run, "export")


def test_command_writes_what_the_methods_give(run, tmp_path):
    (tmp_path / "model.json").write_text(EXAMPLE_MODEL.to_json())
    printed = run("model.json", "--to", "c")
    assert printed.exit_code == 0 and printed.output == EXAMPLE_MODEL.to_c() + "\n"
    assert run("model.json", "--to", "matlab", "-o", "roll.m").output == ""
    assert (tmp_path / "roll.m").read_text() == (
        EXAMPLE_MODEL.to_matlab("roll") + "\n% romsindy export\n"
    )
    refused = run("model.json", "--to", "c", "-o", "my-model.c")
    assert refused.exit_code == 2 and "--name my-model names no function" in refused.stderr
    assert run("model.json", "--to", "c", "-o", "my-model.c", "--name", "rhs").exit_code == 0


@pytest.mark.parametrize("model", MODELS, ids=lambda m: m.terms[-1].key)
def test_sympy_script_runs_and_keeps_every_digit(run, tmp_path, model):
    (tmp_path / "model.json").write_text(model.to_json())
    names = {}
    exec(run("model.json", "--to", "sympy").output, names)
    assert_allclose(evaluated(names["q_ddot"]), evaluated(model.to_sympy()), rtol=1e-13)


@each_of_several
def test_command_exports_several_coordinates(run, tmp_path, title):
    model, q, q_dot, _ = several(title)
    (tmp_path / "model.json").write_text(model.to_json())
    names = {}
    exec(run("model.json", "--to", "sympy").output, names)
    state = np.hstack([q, q_dot])
    for ours, theirs in zip((names["inertia"], names["force"]), model.to_sympy(), strict=True):
        assert_allclose(filled(ours, state), filled(theirs, state), atol=1e-13)
    assert run("model.json", "--to", "c").output == model.to_c() + "\n"


def test_command_exports_what_a_diagnosis_found(run, tmp_path):
    """Its model, unless what it found is no term of that."""

    def diagnosis(name, label):
        content = {
            "effects": [{"name": name, "label": label}],
            "model": json.loads(EXAMPLE_MODEL.to_json()),
        }
        (tmp_path / "diagnosis.json").write_text(json.dumps(content))
        return run("diagnosis.json", "--to", "c")

    assert diagnosis("gain", "a wrong gain").output == EXAMPLE_MODEL.to_c() + "\n"
    for name in ("play", "drift", "base_excitation"):
        refused = diagnosis(name, "what remembers")
        assert refused.exit_code == 2
        assert "found what remembers, which depends on more" in refused.stderr
        assert 'put the entry "model" into a file of its own' in refused.stderr


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"terms": 3}'])
def test_files_without_a_model_are_refused(run, tmp_path, text):
    (tmp_path / "model.json").write_text(text)
    refused = run("model.json", "--to", "c")
    assert refused.exit_code == 2 and refused.stderr.startswith("Error: model.json: ")


ORBIT = {"omega^2": 36.0, "gamma_3": 9.0, "Upsilon_3": 0.3, "c_linear": 0.1, "c_quadratic": 0.2}


@pytest.mark.skipif(shutil.which("gfortran") is None, reason="there is no Fortran compiler")
def test_auto_has_the_acceleration_of_the_model(tmp_path):
    """The subroutine that AUTO calls, compiled, with its damping that makes up for losses."""
    model = ReducedModel.from_coefficients(ORBIT)
    driver = """program main
  double precision :: u(2), par(36), f(2), dfdu(2, 2), dfdp(2, 36)
  integer :: icp(1), ios
  par(1) = 0.25d0
  do
    read(*, *, iostat=ios) u
    if (ios /= 0) exit
    call func(2, u, icp, par, 0, f, dfdu, dfdp)
    print '(2es25.16)', f
  end do
end program
"""
    text = auto_function(model.pairs, str(model), model.coordinates)
    (tmp_path / "model.f90").write_text(f"{text}\n{driver}")
    subprocess.run(["gfortran", "model.f90", "-o", "model"], cwd=tmp_path, check=True)
    points = "\n".join(f"{q!r} {v!r}" for q, v in zip(Q.tolist(), Q_DOT.tolist(), strict=True))
    ran = subprocess.run(
        [tmp_path / "model"], input=points, capture_output=True, text=True, check=True
    )
    rows = np.array([line.split() for line in ran.stdout.splitlines()], float)
    assert_allclose(rows[:, 0], Q_DOT, rtol=1e-15)
    expected = model.acceleration(Q, Q_DOT) + 0.25 * Q_DOT
    assert_allclose(rows[:, 1], expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (COUPLED, "one coordinate"),
        (ReducedModel.from_coefficients({"omega^2": 4.0, "gain [force]": 1.0}), "driven by force"),
        (ReducedModel.from_coefficients({"omega^2": 4.0, "c_coulomb": 1.0}), "c_coulomb jumps"),
    ],
)
def test_auto_is_not_given_what_it_does_not_know(model, words):
    with pytest.raises(ValueError, match=words):
        auto_function(model.pairs, "", model.coordinates)
