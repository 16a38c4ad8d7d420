"""What the stages of a study cost on this machine."""
