"""Which experiment would separate what a recording cannot."""
