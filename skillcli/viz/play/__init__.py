"""`skill play`: a library in the browser, live.

`session` is the simulated arm with everything that can be asked of it, `loop` its clock; neither knows a browser, and both are
tested without one. `view`, `pad`, `controls` and `serve` show them with viser, which only this package imports.
"""
