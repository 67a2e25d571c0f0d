"""Libraries of MACROPs in a database. The only doorway to SQLAlchemy."""
