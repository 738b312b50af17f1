"""Every kind of scene has its equation on a page, a configuration and a committed picture."""

import re
from pathlib import Path

import pytest

from fvi_cli.config import find_config, load_config, shipped_configs
from fvi_cli.scenes.registry import KINDS

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "reference" / "scenes.md").read_text(encoding="utf-8")
SCENES = [kind for kind in KINDS if kind != "fractional-derivative"]
GALLERY = {
    experiment.problem.kind: experiment
    for experiment in load_config(find_config("gallery")).experiments
}


def test_the_gallery_has_every_kind_once():
    assert sorted(GALLERY) == sorted(SCENES)
    assert all(one.name == f"gallery-{kind}" for kind, one in GALLERY.items())


@pytest.mark.parametrize("kind", SCENES)
def test_every_kind_is_documented_and_pictured(kind):
    (figure,) = GALLERY[kind].figures
    path = f"results/figures/gallery-{kind}-{figure}"
    assert f"\n## {kind}\n\n    {KINDS[kind].equation}\n" in PAGE
    assert f"\n![{kind}](../../{path}.png)\n" in PAGE
    assert (ROOT / f"{path}.png").stat().st_size > 100


def test_every_kind_has_a_configuration_beside_the_gallery():
    texts = [find_config(name).read_text() for name in shipped_configs() if name != "gallery"]
    assert set(re.findall(r"\bkind: ([\w-]+)", " ".join(texts))) >= set(SCENES)
