//! A command that has subcommands, and without one of them arguments of its own, as `git stash` has.

use clap::{ArgMatches, Args, Command, Error, FromArgMatches, Subcommand};

/// Its own arguments, or a subcommand's.
pub(crate) enum Either<A, S> {
    Own(Box<A>),
    Sub(S),
}

// By hand: an optional group of arguments that holds another group is never seen as present by the derived code.
impl<A: Args, S: Subcommand> FromArgMatches for Either<A, S> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        if matches.subcommand_name().is_some() {
            return S::from_arg_matches(matches).map(Self::Sub);
        }
        A::from_arg_matches(matches).map(|own| Self::Own(Box::new(own)))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl<A: Args, S: Subcommand> Args for Either<A, S> {
    fn augment_args(command: Command) -> Command {
        let command = S::augment_subcommands(A::augment_args(command));
        command.args_conflicts_with_subcommands(true).subcommand_negates_reqs(true)
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}
