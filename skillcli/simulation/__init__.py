"""The batch engine with sensors, disturbances, domains and safety limits: robot and task as a vector environment."""
