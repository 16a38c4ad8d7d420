"""Material laws as bare derivatives, and the chain rule they share."""
