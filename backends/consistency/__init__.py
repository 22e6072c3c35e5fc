"""Which closures are accepted: groups of robots joined set by set, or the published clique."""
