"""Identify an arm from a log: the domain in which simulated arms move as this one did."""
