"""Makes the modules of the score importable, which are run as scripts."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "score"))
