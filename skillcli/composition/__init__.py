"""Composing frozen skills in the latent space. Planners propose latents and are told outcomes; none sees the simulator."""
