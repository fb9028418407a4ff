//! Work on all threads of the current pool; without the feature `parallel` on the thread that calls. The results are the same.

use std::sync::OnceLock;

#[cfg(feature = "parallel")]
use rayon::prelude::*;

use crate::control::{Cancelled, Control};

/// The values of the indices `0..count`, in order, or an error of one of them.
pub(crate) fn try_map<T: Send, E: Send>(
    count: usize,
    value: impl Fn(usize) -> Result<T, E> + Sync + Send,
) -> Result<Vec<T>, E> {
    #[cfg(feature = "parallel")]
    return (0..count).into_par_iter().map(value).collect();
    #[cfg(not(feature = "parallel"))]
    (0..count).map(value).collect()
}

/// The values of the indices `0..count`, in order.
pub(crate) fn map<T: Send>(count: usize, value: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    #[cfg(feature = "parallel")]
    return (0..count).into_par_iter().map(value).collect();
    #[cfg(not(feature = "parallel"))]
    (0..count).map(value).collect()
}

/// Maps items in order, in chunks that share a working memory. One unit of progress is one item.
pub(crate) fn map_in_chunks<T: Sync, M, V: Send>(
    items: &[T],
    chunk: usize,
    control: Control<'_>,
    memory: impl Fn() -> M + Sync + Send,
    value: impl Fn(&mut M, &T) -> V + Sync + Send,
) -> Result<Vec<V>, Cancelled> {
    let chunks: Vec<&[T]> = items.chunks(chunk).collect();
    let values = try_map(chunks.len(), |index| {
        let mut memory = memory();
        let one = |item| control.check().map(|()| value(&mut memory, item));
        let values = chunks[index].iter().map(one).collect::<Result<Vec<V>, Cancelled>>()?;
        (control.progress)(chunks[index].len() as u64);
        Ok(values)
    })?;
    Ok(values.into_iter().flatten().collect())
}

/// Each chunk of `data` with its number, and a working memory that a thread reuses from chunk to chunk.
pub(crate) fn for_each_chunk<T: Send, M>(
    data: &mut [T],
    chunk: usize,
    memory: impl Fn() -> M + Sync + Send,
    work: impl Fn(&mut M, usize, &mut [T]) + Sync + Send,
) {
    #[cfg(feature = "parallel")]
    data.par_chunks_mut(chunk)
        .enumerate()
        .for_each_init(memory, |memory, (index, data)| work(memory, index, data));
    #[cfg(not(feature = "parallel"))]
    {
        let mut memory = memory();
        data.chunks_mut(chunk).enumerate().for_each(|(index, data)| work(&mut memory, index, data));
    }
}

/// Each chunk of `data` with its number; an error of one of them ends the work.
pub(crate) fn try_for_each_chunk<T: Send, E: Send>(
    data: &mut [T],
    chunk: usize,
    work: impl Fn(usize, &mut [T]) -> Result<(), E> + Sync + Send,
) -> Result<(), E> {
    #[cfg(feature = "parallel")]
    return data.par_chunks_mut(chunk).enumerate().try_for_each(|(index, data)| work(index, data));
    #[cfg(not(feature = "parallel"))]
    data.chunks_mut(chunk).enumerate().try_for_each(|(index, data)| work(index, data))
}

/// The same work on each thread, at most `most` times at once.
pub(crate) fn on_each_thread(most: usize, work: impl Fn() + Sync) {
    #[cfg(feature = "parallel")]
    rayon::scope(|scope| {
        for _ in 0..rayon::current_num_threads().clamp(1, most.max(1)) {
            scope.spawn(|_| work());
        }
    });
    #[cfg(not(feature = "parallel"))]
    {
        let _ = most;
        work();
    }
}

/// The value of a cell, computed where it is empty. A thread that computes it in parallel may meanwhile be given
/// other work that needs the same cell, and would wait for itself: so nothing is locked during the computation. Where
/// several threads compute it at once, the first result stays.
pub(crate) fn make_once<T>(cell: &OnceLock<T>, make: impl FnOnce() -> T) -> &T {
    match cell.get() {
        Some(value) => value,
        None => {
            let made = make();
            cell.get_or_init(|| made)
        }
    }
}

/// Sorts; equal elements in any order.
pub(crate) fn sort<T: Ord + Send>(data: &mut [T]) {
    #[cfg(feature = "parallel")]
    data.par_sort_unstable();
    #[cfg(not(feature = "parallel"))]
    data.sort_unstable();
}
