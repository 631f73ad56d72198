"""Show results: recordings for the viewer and figures for paper, from one plain `Scene`.

Figures must look the same everywhere, so matplotlib's settings are fixed here before it is imported.
"""

import logging
import os

os.environ["MPLBACKEND"] = "agg"  # a notebook's backend would open windows, or is not installed
os.environ["MATPLOTLIBRC"] = os.devnull  # user settings may ask for LaTeX
logging.getLogger("matplotlib").setLevel(logging.CRITICAL)  # remarks about settings, caches and fonts
os.environ["RUST_LOG"] = "off"  # rerun's log; skill reports its errors itself
