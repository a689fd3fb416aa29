"""The no-flow pitch sweep: optical against onboard angle."""
