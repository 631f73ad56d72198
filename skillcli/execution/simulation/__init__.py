"""A simulated arm in a process of its own, in real time, behind a socket: what the driver `simulation` connects to."""
