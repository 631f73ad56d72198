"""One HTML page without external files: no link, script, font or image from elsewhere."""
