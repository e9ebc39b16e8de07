"""The paper's relaxed model: a neural part field and free part poses, fitted by gradient descent. Needs torch."""

from rearticulate.extras import needs

with needs("paper"):
    import torch  # noqa: F401
