"""What notebooks and scripts use of dtwin; `import dtwin` has the names, docs/api.md tells all of them."""
