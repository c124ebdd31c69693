from .scores import nmae, nrmse, ssim

__all__ = ["nmae", "nrmse", "ssim"]
