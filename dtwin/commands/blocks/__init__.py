"""Commands on function blocks: dtwin fb ..."""
