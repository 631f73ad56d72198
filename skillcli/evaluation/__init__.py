"""Frozen skills and plans played and judged: rollouts, planning, replanning, transfer."""
