"""Makes of a network what runs: laid out flat, with a type at every port."""
