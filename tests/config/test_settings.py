"""What Python gives is checked as what stands in a file is, and told in the same words."""

import pytest

from fvi_cli.config import parse_config
from fvi_cli.errors import ArgumentError, ConfigError
from fvi_cli.keys.settings import Positive, Setting, as_plain, key
from fvi_cli.scenes.registry import KINDS
from fvi_cli.studies.accuracy_settings import Accuracy
from fvi_cli.studies.stability_settings import Region, StabilitySettings


class Spring(Setting, refused={"k": "not a key: write stiffness"}):
    """A spring."""

    stiffness: Positive = key("Its stiffness.", unit="mass per time^2")
    from_: float | None = key("Where it begins.", default=None)
    is_linear: bool = key("Whether its force is.", default=True)


class Springs(Setting):
    """Several."""

    springs: tuple[Spring, ...] = key("All of them.", default=[])


def test_a_setting_is_a_frozen_value_with_defaults():
    one = Spring(stiffness=2)
    assert (one.stiffness, one.from_, one.is_linear) == (2.0, None, True)
    assert one == Spring.of({"stiffness": 2.0}) != Spring(stiffness=3.0)
    assert as_plain(one.replaced(from_=1.0)) == {"stiffness": 2.0, "from": 1.0, "is_linear": True}
    with pytest.raises(AttributeError):
        one.stiffness = 3.0
    with pytest.raises(TypeError, match="no k"):
        Spring(k=1.0)


def test_settings_stand_in_settings():
    made = Springs(springs=[Spring(stiffness=1.0), Spring(stiffness=2.0)])
    assert [one.stiffness for one in made.springs] == [1.0, 2.0]
    assert Springs.of(as_plain(made)) == made
    with pytest.raises(ArgumentError) as caught:
        Springs(springs=[made.springs[0].replaced(stiffness=-1.0)])
    assert (caught.value.path, caught.value.key) == (
        ("springs", "0", "stiffness"),
        "springs.0.stiffness",
    )
    with pytest.raises(ArgumentError, match="stiffness: missing"):
        Spring.of({})


TEXT = "name: a\nproblem: {{kind: {}}}\nladder: {{steps: [4]}}\n{}"


@pytest.mark.parametrize(
    ("make", "problem", "more"),
    [
        (lambda: KINDS["pendulum"](omega=-1.0, final_time=1.0),
         "pendulum, omega: -1.0, final_time: 1.0", ""),
        (lambda: KINDS["chain"](final_time=1.0, dampers=[{"order": 3, "coefficient": 1.0}]),
         "chain, final_time: 1.0, dampers: [{order: 3, coefficient: 1.0}]", ""),
        (lambda: KINDS["string"](final_time=1.0, pluck={"at": 2.0}),
         "string, final_time: 1.0, pluck: {at: 2.0}", ""),
        (lambda: StabilitySettings(region={"orders": 0.5, "stiffness": [2, 1], "damping": 1}),
         "pendulum, final_time: 1.0",
         "stability: {region: {orders: 0.5, stiffness: [2, 1], damping: 1}}"),
        (lambda: Accuracy(tolerance=1e-3, relative=0.1), "pendulum, final_time: 1.0",
         "accuracy: {tolerance: 1e-3, relative: 0.1}"),
    ],
)  # fmt: skip
def test_python_is_told_what_a_file_is_told(make, problem, more):
    with pytest.raises(ArgumentError) as caught:
        make()
    with pytest.raises(ConfigError) as told:
        parse_config(TEXT.format(problem, more), "f.yaml")
    assert any(f"{caught.value}" in line for line in told.value.complaints), told.value


def test_what_is_given_well_is_taken():
    region = Region(orders=0.5, stiffness={"from": 1, "to": 3, "number": 3}, damping=[1, 2])
    assert (region.orders, region.stiffness, region.damping) == (
        (0.5,),
        (1.0, 2.0, 3.0),
        (1.0, 2.0),
    )
