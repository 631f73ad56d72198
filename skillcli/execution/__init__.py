"""Onto an arm: drivers, the safety filter, the real-time loop, and what a log tells about an arm."""
