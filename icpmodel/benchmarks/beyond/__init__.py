"""Problems on ranks: what they cost, what they send, and what that says of more ranks than there are here."""
