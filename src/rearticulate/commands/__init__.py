"""What the sub-commands do: load, call, print, save. No algorithm lives here."""
