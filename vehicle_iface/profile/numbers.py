"""Number types of a profile, by allowed range."""

from typing import Annotated

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]
Negative = Annotated[float, msgspec.Meta(lt=0.0)]
