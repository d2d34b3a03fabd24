"""The live page: read-only views of the runtime."""
