"""Every test here runs with rerun raising its errors instead of logging them."""

import os
import sys
from pathlib import Path

os.environ["RERUN_STRICT"] = "1"
sys.path.insert(0, str(Path(__file__).parent))
