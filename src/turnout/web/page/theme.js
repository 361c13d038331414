// Before anything is drawn: colours and size of text as they were chosen last.
(() => {
  const root = document.documentElement;
  const kept = (key, usual) => { try { return localStorage.getItem(key) || usual; } catch { return usual; } };
  root.dataset.theme = kept("theme", "auto");
  root.dataset.text = kept("text", "normal");
})();
