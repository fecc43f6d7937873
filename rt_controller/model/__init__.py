"""The model that the controller drives with: a bundle of encoder and matrices."""
