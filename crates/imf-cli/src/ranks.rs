//! The processes that train together: one, unless `--mpi` is given in a build with the feature `mpi` that `mpirun` started.
//!
//! All ranks do the same work up to the steps of the training and after them; rank 0 alone speaks and writes. How they
//! stop, so that none waits for one that is gone:
//!
//! - At Ctrl-C (`mpirun` turns it into SIGTERM for all) every rank records the request; at the next report an allreduce says
//!   whether any rank has one. If so, all leave the loop at that step and finalise MPI.
//! - A rank that fails says why and ends all others by `MPI_Abort`. What all ranks meet alike, such as a dataset that is not
//!   there, rank 0 says first and alone: the others wait a moment before they speak.
//! - `mpirun` detects a rank that panics or is killed, and ends the others.

#[cfg(feature = "mpi")]
mod world;

use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Result, bail};
use imf_core::field::EngineError;
use imf_train::engine::CpuTrainer;
use imf_train::engine::ranks::{BYTES_PER_PARAMETER, most_rows};
use imf_train::training::TrainingEngine;

/// True once all ranks have agreed to stop.
static AGREED: AtomicBool = AtomicBool::new(false);

/// This process among those that train together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rank {
    /// From 0.
    pub(crate) number: usize,
    /// Processes that train together.
    pub(crate) size: usize,
    /// Those of them that share this machine's memory.
    pub(crate) neighbours: usize,
}

/// Membership in MPI, for as long as the process takes part in it.
pub(crate) struct Membership {
    pub(crate) rank: Rank,
    #[cfg(feature = "mpi")]
    world: Option<world::World>,
}

impl Membership {
    /// Joins the ranks that `mpirun` started, if requested.
    pub(crate) fn join(wished: bool) -> Result<Self> {
        if !wished {
            return Ok(Self {
                rank: Rank::alone(),
                #[cfg(feature = "mpi")]
                world: None,
            });
        }
        #[cfg(feature = "mpi")]
        {
            let world = world::World::join()?;
            Ok(Self { rank: world.rank(), world: Some(world) })
        }
        #[cfg(not(feature = "mpi"))]
        bail!(
            "this imf was built without MPI: build it by `cargo build --release --features mpi`, which needs an MPI library \
             and libclang (Debian: openmpi-bin libopenmpi-dev libclang-dev)"
        )
    }

    /// Waits a moment before an error of this rank is shown, unless it speaks for all.
    pub(crate) fn let_the_first_speak(&self) {
        #[cfg(feature = "mpi")]
        if !self.rank.is_first() {
            // By then rank 0, if it has met the same, has ended this process.
            std::thread::sleep(std::time::Duration::from_secs(2));
        }
    }

    /// Leaves with the others, or ends them where this rank failed alone.
    pub(crate) fn leave(self, code: u8) {
        #[cfg(feature = "mpi")]
        if let Some(world) = self.world {
            if code == 0 || AGREED.load(Ordering::Relaxed) {
                world.finish();
            } else {
                world::abort(code);
            }
        }
        #[cfg(not(feature = "mpi"))]
        let _ = code;
    }
}

impl Rank {
    /// The only process.
    pub(crate) fn alone() -> Self {
        Self { number: 0, size: 1, neighbours: 1 }
    }

    /// True for the one that speaks and writes.
    pub(crate) fn is_first(self) -> bool {
        self.number == 0
    }

    /// Bytes beside the engine for each parameter.
    pub(crate) fn bytes_per_parameter(self) -> u64 {
        if self.size == 1 { 0 } else { BYTES_PER_PARAMETER }
    }

    /// Samples of a batch that this rank has at most.
    pub(crate) fn most_rows(self, batch: usize) -> usize {
        most_rows(batch, self.size)
    }

    /// Allgather of a number. Collective: all ranks must call it.
    fn all(self, number: u64) -> Result<Vec<u64>, EngineError> {
        #[cfg(feature = "mpi")]
        if self.size > 1 {
            return imf_train::engine::ranks::Collectives::all_gather_number(
                &mut world::MpiCollectives::new(self),
                number,
            );
        }
        Ok(vec![number])
    }

    /// Allreduce (or) of the request to stop. Collective: all ranks must call it.
    pub(crate) fn stop(self, wished: bool) -> Result<bool> {
        let stop = self.all(u64::from(wished))?.contains(&1);
        if stop {
            AGREED.store(true, Ordering::Relaxed);
        }
        Ok(stop)
    }

    /// Allreduce (minimum) of a number. Collective: all ranks must call it.
    pub(crate) fn minimum(self, number: u64) -> Result<u64> {
        Ok(self.all(number)?.into_iter().min().unwrap_or(number))
    }

    /// Fails where `number`, a checksum of `what`, is not the same on all ranks. Collective: all ranks must call it.
    pub(crate) fn agree(self, what: &str, number: u64) -> Result<()> {
        let all = self.all(number)?;
        if let Some(other) = all.iter().position(|found| *found != all[0]) {
            bail!("ranks 0 and {other} see a different {what}: give all ranks the same arguments and files");
        }
        Ok(())
    }

    /// The engine of this rank, for its part of every batch.
    pub(crate) fn trainer(self, cpu: CpuTrainer) -> Box<dyn TrainingEngine> {
        #[cfg(feature = "mpi")]
        if self.size > 1 {
            let reach = world::MpiCollectives::new(self);
            return Box::new(imf_train::engine::ranks::RankTrainer::new(cpu, reach));
        }
        Box::new(cpu)
    }
}

/// How many processes a launcher of MPI says that it started, where this one does not take part.
pub(crate) fn started_together() -> Option<usize> {
    let counts = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE"].iter().filter_map(|name| std::env::var(name).ok());
    counts.filter_map(|count| count.parse().ok()).find(|&count| count > 1)
}
