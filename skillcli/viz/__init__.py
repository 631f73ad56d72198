"""Results made visible: recordings for the viewer and figures for paper, from one plain `Scene`."""
