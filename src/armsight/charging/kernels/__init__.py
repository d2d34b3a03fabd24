"""Hot loops of finding and fitting: directions of edges, votes, rings, templates, edge search."""
