# ranks: 1
# labels: long
# timeout: 7200
# A thousand problems without a solution and a thousand with one, of up to 2000 unknowns, and a thousand small ones of all kinds.
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import solvable

sys.exit(1 if solvable.main("full", count=1000, largest=2000, small_count=1000, timeout=6000) else 0)
