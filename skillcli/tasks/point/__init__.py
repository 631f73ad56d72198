"""Move a point in the plane; no physics."""
