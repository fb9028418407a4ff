//! Slices of fields as pictures.
