"""Control laws: found, checked, given to teams of followers, and told of their leader."""
