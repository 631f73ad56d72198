"""`skill`: learn, compose and transfer robot skills, with every result kept as a versioned artifact."""

__version__ = "0.1.0"
