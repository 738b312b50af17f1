"""Methods look and are named alike in all figures, and no two of them alike in one."""

from itertools import combinations

from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.plotting.looks import method_looks

EULER = Baseline(name="explicit-euler")


def test_methods_are_told_apart_in_colour_and_in_grey():
    methods: list[AnyMethod] = [
        *(Method(cq=f"bdf{p}", degree=1, sampling="nodes") for p in range(1, 7)),
        Method(cq="bdf2", degree=2, sampling="nodes"),
        Method(cq="bdf2", degree=2),
        Method(cq="bdf2", degree=2, start="weights", start_exponents=(2.5,)),
        Method(cq="gauss", degree=2),
        Method(cq="gauss", degree=3, start="graded"),
        EULER,
    ]
    found = method_looks(methods)
    assert len({one.label for one in found.values()}) == len(found) == len(methods)
    looks = [one.look for one in found.values()]
    for a, b in combinations(looks, 2):
        assert (a.marker, a.is_filled, a.dashes) != (b.marker, b.is_filled, b.dashes)
        assert (a.colour, a.is_filled, a.dashes) != (b.colour, b.is_filled, b.dashes)
    for part in ("colour", "marker"):
        assert len({getattr(look, part) for look in looks[:6]}) == 6


def test_variants_of_one_quadrature_have_colours_of_their_own():
    four = [
        Method(cq="bdf3", degree=d, start=start, start_exponents=powers)
        for d in (1, 2)
        for start, powers in (("none", ()), ("weights", (2.5,)))
    ]
    assert len({one.look.colour for one in method_looks(four).values()}) == 4
    # the control: beside another family a quadrature keeps its colour
    both = method_looks([*four, Method(cq="bdf2", degree=1)])
    assert both[four[0].case].look.colour == method_looks(four[:1])[four[0].case].look.colour


def test_a_method_looks_the_same_in_every_figure():
    families = [
        *(Method(cq=f"bdf{p}", degree=d) for p in range(1, 7) for d in (1, 2)),
        *(Method(cq=cq, degree=s) for cq in ("gauss", "lobatto-iiic") for s in range(1, 5)),
        EULER,
    ]
    together = {case: one.look for case, one in method_looks(families).items()}
    for method in families:
        (alone,) = method_looks([method]).values()
        assert alone.look == together[method.case]
    # the control: another quadrature looks otherwise
    assert len({(look.colour, look.is_filled) for look in together.values()}) == len(families)


def test_powers_in_names_are_typeset():
    corrected = Method(cq="bdf3", degree=2, start="weights", start_exponents=(2.5,))
    (look,) = method_looks([corrected]).values()
    assert look.label == "BDF3 (degree 2, weights $t^{5/2}$, galerkin forcing)"
