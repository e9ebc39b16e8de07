"""The paper's relaxed model: a neural part field and free part poses, fitted by gradient descent. Needs torch."""

from rearticulate.fit.neural.extra import require

require("torch")
