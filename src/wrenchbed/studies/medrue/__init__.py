"""The MedRUE paper, reproduced, held against the physical limit, and gone beyond."""
