"""Many runs of one recipe: which cells there are, and how they run on this machine, on a cluster, or in a search."""
