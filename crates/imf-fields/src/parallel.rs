//! Work on all threads of the current rayon pool; without the feature `parallel` on the thread that calls. The results are the
//! same.

#[cfg(feature = "parallel")]
pub(crate) use rayon::{current_num_threads as threads, prelude::*};

#[cfg(not(feature = "parallel"))]
pub(crate) use one_thread::*;

/// Rayon's methods as those of plain iterators.
#[cfg(not(feature = "parallel"))]
mod one_thread {
    use std::slice::{Chunks, ChunksExactMut, ChunksMut, IterMut};

    pub(crate) fn threads() -> usize {
        1
    }

    pub(crate) trait Slices<T> {
        fn par_iter(&self) -> std::slice::Iter<'_, T>;
        fn par_chunks(&self, size: usize) -> Chunks<'_, T>;
        fn par_iter_mut(&mut self) -> IterMut<'_, T>;
        fn par_chunks_mut(&mut self, size: usize) -> ChunksMut<'_, T>;
        fn par_chunks_exact_mut(&mut self, size: usize) -> ChunksExactMut<'_, T>;
    }

    impl<T> Slices<T> for [T] {
        fn par_iter(&self) -> std::slice::Iter<'_, T> {
            self.iter()
        }
        fn par_chunks(&self, size: usize) -> Chunks<'_, T> {
            self.chunks(size)
        }
        fn par_iter_mut(&mut self) -> IterMut<'_, T> {
            self.iter_mut()
        }
        fn par_chunks_mut(&mut self, size: usize) -> ChunksMut<'_, T> {
            self.chunks_mut(size)
        }
        fn par_chunks_exact_mut(&mut self, size: usize) -> ChunksExactMut<'_, T> {
            self.chunks_exact_mut(size)
        }
    }

    pub(crate) trait IntoParallel: IntoIterator + Sized {
        fn into_par_iter(self) -> Self::IntoIter {
            self.into_iter()
        }
    }

    impl<I: IntoIterator> IntoParallel for I {}

    pub(crate) trait Parallel: Iterator + Sized {
        fn with_min_len(self, _: usize) -> Self {
            self
        }
        fn map_init<M, R>(
            self,
            memory: impl Fn() -> M,
            work: impl Fn(&mut M, Self::Item) -> R,
        ) -> impl Iterator<Item = R> {
            let mut memory = memory();
            self.map(move |item| work(&mut memory, item))
        }
        fn for_each_init<M>(self, memory: impl Fn() -> M, work: impl Fn(&mut M, Self::Item)) {
            self.map_init(memory, work).for_each(drop);
        }
        fn try_for_each_init<M, E>(
            self,
            memory: impl Fn() -> M,
            work: impl Fn(&mut M, Self::Item) -> Result<(), E>,
        ) -> Result<(), E> {
            self.map_init(memory, work).collect()
        }
    }

    impl<I: Iterator> Parallel for I {}
}
