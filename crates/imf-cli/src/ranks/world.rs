//! Ranks reach each other by MPI, from the main thread only.

use anyhow::{Context as _, Result, bail};
use imf_core::field::EngineError;
use imf_train::engine::ranks::Collectives;
use mpi::Threading;
use mpi::datatype::{Partition, PartitionMut};
use mpi::environment::Universe;
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator as _, CommunicatorCollectives as _};

use super::Rank;

/// An initialised MPI; there is only one.
pub(super) struct World {
    universe: Universe,
}

impl World {
    pub(super) fn join() -> Result<Self> {
        let (universe, threading) =
            mpi::initialize_with_threading(Threading::Funneled).context("MPI does not start")?;
        if threading < Threading::Funneled {
            bail!("this MPI library does not allow threads beside the one that calls it");
        }
        // A process that unwound would wait for the others at MPI's end: die so that mpirun notices.
        let shown = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            shown(panic);
            std::process::abort();
        }));
        Ok(Self { universe })
    }

    pub(super) fn rank(&self) -> Rank {
        let world = self.universe.world();
        let neighbours = world.split_shared(world.rank()).size();
        Rank { number: world.rank() as usize, size: world.size() as usize, neighbours: neighbours as usize }
    }

    /// Ends MPI together with all others.
    pub(super) fn finish(self) {
        drop(self.universe);
    }
}

/// Ends all ranks, this one included.
pub(super) fn abort(code: u8) -> ! {
    SimpleCommunicator::world().abort(i32::from(code))
}

/// Communication with the other ranks; MPI aborts all of them on failure.
pub(super) struct MpiCollectives {
    world: SimpleCommunicator,
    rank: Rank,
    /// Values dealt to, and received from, each rank, and where they begin.
    given: (Vec<i32>, Vec<i32>),
    taken: (Vec<i32>, Vec<i32>),
}

impl MpiCollectives {
    pub(super) fn new(rank: Rank) -> Self {
        let none = (Vec::new(), Vec::new());
        Self { world: SimpleCommunicator::world(), rank, given: none.clone(), taken: none }
    }

    /// Works out lengths and beginnings once.
    fn plan(&mut self, cuts: &[usize]) -> Result<(), EngineError> {
        if self.given.0.len() + 1 == cuts.len() {
            return Ok(());
        }
        let ranks = self.rank.size;
        let own = cuts[self.rank.number + 1] - cuts[self.rank.number];
        if i32::try_from(cuts[ranks].max(own * ranks)).is_err() {
            return Err(EngineError::Shape("MPI counts to 2^31: a smaller network".into()));
        }
        self.given.0 = cuts.windows(2).map(|pair| (pair[1] - pair[0]) as i32).collect();
        self.given.1 = cuts[..ranks].iter().map(|&cut| cut as i32).collect();
        self.taken.0 = vec![own as i32; ranks];
        self.taken.1 = (0..ranks).map(|rank| (rank * own) as i32).collect();
        Ok(())
    }
}

impl Collectives for MpiCollectives {
    fn rank(&self) -> usize {
        self.rank.number
    }

    fn ranks(&self) -> usize {
        self.rank.size
    }

    fn all_to_all(&mut self, values: &[f32], cuts: &[usize], parts: &mut [f32]) -> Result<(), EngineError> {
        self.plan(cuts)?;
        let given = Partition::new(values, &self.given.0[..], &self.given.1[..]);
        let mut taken = PartitionMut::new(parts, &self.taken.0[..], &self.taken.1[..]);
        self.world.all_to_all_varcount_into(&given, &mut taken);
        Ok(())
    }

    fn all_gather(&mut self, slice: &[f32], cuts: &[usize], values: &mut [f32]) -> Result<(), EngineError> {
        self.plan(cuts)?;
        let mut all = PartitionMut::new(values, &self.given.0[..], &self.given.1[..]);
        self.world.all_gather_varcount_into(slice, &mut all);
        Ok(())
    }

    fn all_gather_number(&mut self, number: u64) -> Result<Vec<u64>, EngineError> {
        let mut all = vec![0; self.rank.size];
        self.world.all_gather_into(&number, &mut all[..]);
        Ok(all)
    }
}
