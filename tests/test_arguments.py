"""Wrong calls of the public functions and classes say which arguments there are."""

import inspect
import pickle
import re

import pytest

import fvi_cli as fvi

SCENE = fvi.duffing(final_time=1.0)
CLASSES = ("FractionalDamping", "Scene", "Inertia", "Forcing", "Law", "Method", "Symmetry")
PUBLIC = [name for name in dir(fvi) if inspect.isfunction(getattr(fvi, name, None))]


@pytest.mark.parametrize("name", [*PUBLIC, *CLASSES, "QuadraticPotential", "ExpressionPotential"])
def test_an_argument_that_there_is_not_is_answered_with_those_that_there_are(name):
    function = getattr(fvi, name)
    known = list(inspect.signature(function).parameters)
    with pytest.raises(TypeError, match="'qqq' is no argument") as caught:
        function(qqq=1.0)
    assert str(caught.value).endswith(f"(arguments: {', '.join(known)})")


@pytest.mark.parametrize("name", PUBLIC)
def test_public_functions_are_found_again_by_processes_that_are_sent_them(name):
    function = getattr(fvi, name)
    if not hasattr(function, "__signature__"):
        assert pickle.loads(pickle.dumps(function)) is function
    assert getattr(fvi, name) is function


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: fvi.integrate(SCENE, "gauss3"), r"n_steps is missing; write integrate\(n_steps="),
        (lambda: fvi.integrate(SCENE, "gauss3", steps=9), "'steps' is no argument; write n_steps"),
        (lambda: fvi.integrate(SCENE, "gauss3", 9, n_steps=9), "n_steps is given twice"),
        (lambda: fvi.integrate("duffing", "gauss3", 9), "scene: 'duffing' is no scene; write one"),
        (lambda: fvi.integrate(SCENE, 3, 9), "method: 3 is no method; write a name such as"),
        (lambda: fvi.solve(SCENE, tol=1e-6), "'tol' is no argument; write tolerance"),
        (lambda: fvi.solve(SCENE, 1e-6), r"at most 1 of the arguments .* write solve\(scene\)"),
        (lambda: fvi.duffing(1.0), r"none of the arguments .* write duffing\(final_time=\.\.\.\)"),
        (
            lambda: fvi.FractionalDamping(0.5, 0.2),
            r"none of .* write FractionalDamping\(coefficient=\.\.\., order=\.\.\.\)",
        ),
        (lambda: fvi.sandwich_beam(3), "none of the arguments may stand without its name"),
    ],
)
def test_what_to_write_in_place_of_wrong_calls(call, message):
    with pytest.raises(TypeError, match=message):
        call()


@pytest.mark.parametrize("name", ["stiffness", "initial_position"])
def test_a_text_in_place_of_a_number_is_said_of_its_argument(name):
    with pytest.raises(ValueError, match=f"^{name}: 'soft' is not a number$"):
        fvi.duffing(final_time=1.0, **{name: "soft"})


def test_an_error_inside_of_a_right_call_stays_what_it_is():
    class Wrong:
        def energy(self, position):
            return position + "a"

    with pytest.raises((TypeError, ValueError)) as caught:
        fvi.Scene(
            inertia=fvi.Inertia(mass=1.0),
            potential=Wrong(),
            initial_position=0.0,
            initial_velocity=0.0,
            final_time=1.0,
        )
    assert not re.search("no argument|is missing", str(caught.value))
