"""Learn skills and their embedding: networks, rollouts, advantages and TE-PPO. Imports neither simulator nor store."""
