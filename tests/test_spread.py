"""What is drawn for a day: as much as is wanted, the same all day, and everything in its turn."""

import dataclasses

import pytest
from spread import SEED, draw_few


@dataclasses.dataclass
class Case:
    """What is asked of a collected test."""

    nodeid: str
    marks: dict[str, pytest.Mark]

    def get_closest_marker(self, name: str) -> pytest.Mark | None:
        return self.marks.get(name)

    def add_marker(self, name: str) -> None:
        self.marks[name] = getattr(pytest.mark, name).mark


def drawn(few: int) -> list[str]:
    mark = pytest.mark.few(few).mark
    cases = [Case(f"a.py::test[{k}]", {"few": mark}) for k in range(5)]
    cases += [Case("b.py::test", {"few": mark}), Case("c.py::test[0]", {})]
    draw_few(cases)
    return [one.nodeid for one in cases if "slow" not in one.marks]


@pytest.mark.parametrize("few", [1, 3, 9])
def test_so_many_cases_are_drawn_each_day_and_all_of_them_have_their_days(few, monkeypatch):
    found = set()
    for day in range(40):
        monkeypatch.setenv(SEED, str(day))
        first = drawn(few)
        assert len(first) == min(few, 5) + 2
        assert {"b.py::test", "c.py::test[0]"} < set(first)
        assert drawn(few) == first
        found |= set(first)
    assert len(found) == 7
