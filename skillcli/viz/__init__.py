"""Results made visible: recordings for the viewer and figures for paper, from one plain `Scene`.

Figures look the same for everybody: what matplotlib takes from its surroundings when it is loaded is set here, before that.
"""

import logging
import os

os.environ["MPLBACKEND"] = "agg"  # a notebook's would open windows, or is not installed here
os.environ["MATPLOTLIBRC"] = os.devnull  # settings of one's own, which may ask for LaTeX
logging.getLogger("matplotlib").setLevel(logging.CRITICAL)  # remarks about settings, caches and fonts
os.environ["RUST_LOG"] = "off"  # rerun's log; what went wrong is told by ourselves
