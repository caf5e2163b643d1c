"""The commands, one thin module each; no logic lives here."""
