"""``string``: the sine modes of a string that is held at both ends."""

from __future__ import annotations

from typing import Final

from fvi_cli.keys.records import Key, Record
from fvi_cli.keys.scalars import Integer, Number
from fvi_cli.scenes.chains import string
from fvi_cli.scenes.kinds.kind import SceneKind, scene_record
from fvi_cli.scenes.kinds.shared_keys import dampers_key

_PLUCK: Final = Record(
    keys=(
        Key(
            "at",
            Number(above=0.0, below=1.0),
            "Place, as a fraction of the length (no unit).",
            default=0.5,
        ),
        Key("height", Number(), "Height there.", unit="length", default=0.0),
    )
)


STRING: Final = SceneKind(
    name="string",
    equation="u_tt + sum mu D^gamma u - sum eta D^gamma u_ss = wave_speed^2 u_ss in sine modes "
    "x1, x2, ...",
    record=scene_record(
        Key(
            "modes",
            Integer(least=1, most=1000),
            "Number n of sine modes; the coordinates x1 ... xn are their amplitudes.",
            default=8,
        ),
        Key(
            "wave_speed",
            Number(above=0.0),
            "c, the speed of waves.",
            unit="length per time",
            default=1.0,
        ),
        Key(
            "length", Number(above=0.0), "L, the distance of the ends.", unit="length", default=1.0
        ),
        Key(
            "pluck",
            _PLUCK,
            "A triangle that is added to the initial position.",
            default={"at": 0.5, "height": 0.0},
            build=lambda pluck: (pluck["at"], pluck["height"]),
        ),
        dampers_key(
            "internal_damping",
            "Terms -eta D^gamma u_ss of the material, eta their coefficient.",
            "length^2 times time^(gamma-2)",
        ),
    ),
    make=string,
    size_key="modes",
    example={
        "modes": "4",
        "pluck": "{at: 0.3, height: 0.1}",
        "internal_damping": "[{order: 0.5, coefficient: 0.01}]",
        "final_time": "2.0",
    },
    sweep="problem.pluck.at: [0.1, 0.3, 0.5]",
)
