"""Where the standard blocks of 4diac FORTE depart from the standards: the table, and the cases of its rows."""
