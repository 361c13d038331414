"""Which law a drive follows: variants of the bilinear bushing, fitted and compared."""
