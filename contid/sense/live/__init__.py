"""The force on the tip of a pneumatic arm, estimated in its ticks."""
