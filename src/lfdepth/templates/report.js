document.addEventListener("click", (event) => {
  if (event.target.matches(".pictures img")) event.target.classList.toggle("large");
});
