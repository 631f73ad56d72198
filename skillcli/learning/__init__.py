"""Learning skills and their embedding: networks, rollouts, advantages and TE-PPO. Knows neither simulator nor store."""
