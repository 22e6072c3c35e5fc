"""What is done with closures: consistency, pose graph, merged trajectories and map."""
