"""Electric field, salt and water flow around a charged pore in a membrane."""
