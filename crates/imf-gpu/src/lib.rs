//! Training and evaluation on the GPU.
