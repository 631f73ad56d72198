"""The batched simulation: robot and task as a vector environment, with sensors, disturbances, domains and safety limits."""
