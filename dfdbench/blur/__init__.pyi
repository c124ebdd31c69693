from .recipe import RECIPES, BlurRecipe, find_recipe
from .synthesis import synthesize

__all__ = ["RECIPES", "BlurRecipe", "find_recipe", "synthesize"]
