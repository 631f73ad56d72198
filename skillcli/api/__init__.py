"""The functions and classes behind `import skillcli`. Modules here load torch and the engine only inside functions."""
