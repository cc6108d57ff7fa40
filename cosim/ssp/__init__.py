"""The formation as a system of FMUs (SSP): written for other masters, and read again."""
