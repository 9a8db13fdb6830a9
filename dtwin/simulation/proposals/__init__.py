"""Proposals of an AI: checked like uploads, kept in a file, decided once by a person."""
