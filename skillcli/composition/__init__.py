"""Compose frozen skills in the latent space. A planner proposes latents and receives outcomes; it never sees the simulator."""
