"""The search for the pose nearest to a target along the branch on which the arm stands."""
