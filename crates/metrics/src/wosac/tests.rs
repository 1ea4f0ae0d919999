mod attack;
mod fixture;
mod golden;
mod pruning;
mod quirks;
mod shares;
