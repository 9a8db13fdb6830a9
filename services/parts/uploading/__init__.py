"""What the simulation services of all arms share: uploads that a running controller gets, and their trials."""
