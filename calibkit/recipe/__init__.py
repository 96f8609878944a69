"""Recipes: frozen records of what a laboratory decided, and their strict loader."""

from calibkit.recipe.loader import Source, find, parse, shipped
from calibkit.recipe.tables import ColumnMapping, Exclude, Logs, Recipe, Site
from calibkit.recipe.type_b import TypeB

__all__ = [
    "ColumnMapping",
    "Exclude",
    "Logs",
    "Recipe",
    "Site",
    "Source",
    "TypeB",
    "find",
    "parse",
    "shipped",
]
