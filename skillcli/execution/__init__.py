"""Onto an arm: the policy in one file, drivers, the safety filter, the real-time loop, and what a log tells about an arm."""
