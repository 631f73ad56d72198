"""Push a box over the table."""
