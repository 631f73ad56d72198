"""The command line: parses, calls one stage, prints. Only this package prints or exits."""
