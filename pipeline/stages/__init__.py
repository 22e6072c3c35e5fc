"""What a run does, stage by stage, and the folder that it leaves."""
