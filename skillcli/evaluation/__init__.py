"""Run frozen skills and plans and measure them: rollouts, planning, replanning, transfer."""
