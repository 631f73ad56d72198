"""The command line: parses, calls one stage, prints. The only place that prints or exits."""
