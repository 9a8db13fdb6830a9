"""The console of an arm that is not the thesis's: what it is told of n joints, and its commands."""
