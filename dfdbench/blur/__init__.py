"""How a defocus image comes about."""

from dfdbench.blur.synthesis import RECIPES, BlurRecipe, find_recipe, synthesize

__all__ = ["RECIPES", "BlurRecipe", "find_recipe", "synthesize"]
