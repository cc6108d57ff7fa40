"""Control laws: found, checked, given to teams of followers, with a view of their leader."""
