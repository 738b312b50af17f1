"""What tests of all rooms share: this folder and the project's lie on the path."""

from __future__ import annotations

import sys
from pathlib import Path

# benchmarks/ is not installed; the package itself is, and comes before
sys.path.append(str(Path(__file__).parents[1]))
