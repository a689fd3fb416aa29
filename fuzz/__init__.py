"""Damaged and lying files: whatever a file holds, the program reads it or says what is wrong."""
