"""The commands of the command line as functions, for notebooks and programs.

``import fvi_cli as fvi`` gives every name of this module; each is loaded when it is first used.

=================== ===========================================================================
command             call
=================== ===========================================================================
``fvi check``       :func:`load`
``fvi run``         :func:`run`
``fvi show``        :func:`contents`; every run: :func:`recall`
``fvi convergence`` :func:`order_tables` of what :func:`run` or :func:`recall` gives
``fvi plot``        :func:`figures` of the same
``fvi quantities``  :func:`quantities` of the same; every run: ``trajectory.observed``
``fvi stability``   :func:`stability`
``fvi modes``       :func:`modes`
``fvi response``    :func:`response`
``fvi cost``        :func:`cost`
``fvi fit``         :func:`fit`
``fvi export``      :func:`export`
=================== ===========================================================================

:func:`as_text` returns what a command prints of a result, and :func:`write` writes the result to
files. Without a configuration, :func:`integrate` computes a :class:`Scene` by a :class:`Method` or
its name, :func:`solve` computes it to a tolerance, and :func:`gradient` differentiates a number of
its run with respect to its parameters.

Examples
--------
>>> import fvi_cli as fvi
>>> config = fvi.load("damped-oscillator", overrides=["ladder.steps=[256, 512]"])
>>> outcome, = fvi.run(config)
>>> outcome.finished[0].trajectory.position.shape
(257, 1)
>>> [table] = fvi.order_tables([outcome])
>>> table.cases[0].method.case, round(table.cases[0].slope, 1)
('bdf1-nodes-s1-gauss1-none', 0.9)
>>> sorted(fvi.figures([outcome]))[0]
'damped-oscillator-convergence'
>>> [table] = fvi.stability(config)
>>> {row.prediction.verdict for row in table.rows}
{'stable'}
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fvi_cli.api.names import *  # noqa: F403


def __getattr__(name: str) -> Any:
    """A public name; loaded on demand, so that the command line, which needs none, starts fast."""
    names = importlib.import_module("fvi_cli.api.names")
    if name == "__all__":
        return [one for one in vars(names) if not one.startswith("_")]
    return getattr(names, name)
