"""Wrong calls of the public functions and classes say which arguments there are."""

import inspect
import pickle

import pytest

import fvi_cli as fvi

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
