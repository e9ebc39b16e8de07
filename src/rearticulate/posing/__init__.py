"""A finished model in other postures: what posing, localization, exports and pictures share."""
