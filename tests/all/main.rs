//! One integration-test binary: linking is the hidden cost of many. Each module asks one kind of
//! question.

mod attas;
mod campaign;
mod closure;
mod coverage;
mod diagnosis;
mod dlc;
mod faults;
mod flightdata;
mod floors;
mod fragments;
mod hfb320;
mod language;
mod models;
mod modes;
mod pages;
mod path;
mod phlab;
mod readers;
mod real;
mod recovery;
mod reruns;
mod simulator;
mod stages;
mod structure;
mod trials;
