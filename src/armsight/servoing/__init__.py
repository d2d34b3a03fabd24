"""Visual servoing to moving targets (V): detection, one estimate, the Master, and the laws."""
